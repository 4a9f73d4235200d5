"""A recording that is made from the lab's page, of the simulated robot; not while a service has the ports."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from playwright.sync_api import expect

from lostmotion.daemon.store import Store
from lostmotion.drivers.recording import read_recording
from tests.web.conftest import Open, Serve, overflow, violations


@pytest.mark.slow
def test_a_joint_is_recorded_and_used(tmp_path: Path, serve: Serve, look: Open) -> None:
    """Two seconds of the elbow: rows at the rates of its devices, and the recording is chosen in the lab."""
    site = serve("--database", tmp_path / "history.db")
    page = look(f"{site.address}/lab", width=400)
    page.locator("body[data-loaded]").wait_for()
    page.locator("#record-details summary").click()
    page.locator("#joint").select_option("elbow")
    page.locator("#seconds").fill("2")
    assert violations(page) == []
    page.locator("#record").click()
    page.locator("#run[data-shown]").wait_for(timeout=120_000)
    expect(page.locator("#words")).to_contain_text("s of joint elbow: servo 100 Hz and accelerometer 1000 Hz")
    assert overflow(page) <= 0
    page.locator("#again").click()
    chosen = page.locator("#recordings :checked")
    expect(chosen).to_have_count(1)
    recording = read_recording(tmp_path / "lab" / "recordings" / str(chosen.get_attribute("value")))
    assert recording.duration == pytest.approx(2.0, abs=0.1)
    assert recording.metadata["joint"] == "elbow"
    assert {"command", "position", "accel"} <= recording.columns.keys()


def test_a_running_service_keeps_its_ports(tmp_path: Path, serve: Serve) -> None:
    """The page says what to do instead of offering it; who asks all the same is refused, and so is an unknown joint."""
    site = serve("--database", tmp_path / "history.db")
    asked = {"joint": "elbow", "seconds": 1}
    store = Store(tmp_path / "history.db", "arm1")
    try:
        assert b"stop it" in site.ask("GET", "/lab")[2]
        token = site.csrf()
        status, _, body = site.ask("POST", "/api/lab/record", asked, x_csrf_token=token)
        assert (status, "has the ports" in json.loads(body)["error"]) == (409, True)
    finally:
        store.close()
    for wrong in ({"joint": "nobody"}, {"seconds": 1e9}, {"seconds": -1}):
        assert site.ask("POST", "/api/lab/record", asked | wrong, x_csrf_token=token)[0] in (404, 422)
    assert site.ask("POST", "/api/lab/record", asked)[0] == 403
