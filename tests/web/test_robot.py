"""The first page in a real browser: what it shows, what comes while it is open, what people do about alarms."""

from __future__ import annotations

import json
import re
import shutil
import threading
from contextlib import closing
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from playwright.sync_api import expect

from lostmotion.daemon.lifecycle import raised
from lostmotion.daemon.reader import open_readonly
from lostmotion.daemon.records import AlarmState, Cause, Health, JointRow, ScoreRow, Severity, SinkRow, SinkRows, iso
from lostmotion.daemon.store import Store
from tests.daemon import zenoh_world
from tests.daemon.cli_world import call
from tests.daemon.conftest import Running, free_endpoint, start, wait_until
from tests.daemon.fakes import fake_config
from tests.web.conftest import Open, Serve, overflow, violations
from tests.web.world import HOSTILE, fill, robot

__all__ = ["start"]


@pytest.mark.slow
def test_ten_pages_of_a_browser_hear_the_news(tmp_path: Path, serve: Serve, look: Open) -> None:
    """A browser opens six connections to a server; the tenth page comes, and all ten hear of a new score."""
    fill(tmp_path / "history.db", count=40)
    site = serve("--config", robot(tmp_path))
    pages = [look(site.address)]
    for _ in range(9):
        page = pages[0].context.new_page()
        page.goto(site.address)
        pages.append(page)
    pages[3].close()
    store = Store(tmp_path / "history.db", "arm1")
    store.add(ScoreRow("elbow", datetime.now(UTC), 0.25, 77.25, 4.0, True))
    store.close()
    for page in pages[:3] + pages[4:]:
        expect(page.locator('[data-joint="elbow"].card [data-field="score"]')).to_have_text(re.compile(r"77\.2"))


def test_programs_get_numbers(tmp_path: Path, serve: Serve) -> None:
    """Beside the texts of the page is the document of the command line: SI units, times in ISO 8601."""
    last = fill(tmp_path / "history.db", count=40)
    site = serve("--config", robot(tmp_path))
    status, _, body = site.ask("GET", "/api/status")
    found = json.loads(body)
    assert status == 200
    assert found["joints"][0]["severity"].endswith("µm)")
    (elbow,) = found["status"]["joints"]
    assert elbow["last_window"] == iso(last)
    assert float(found["joints"][0]["severity"].split("'")[0]) == pytest.approx(elbow["severity"] * 3437.75, abs=0.06)
    printed = json.loads(call("status", "--database", tmp_path / "history.db", "--json").stdout)
    assert found["status"] == printed


@pytest.mark.slow
@pytest.mark.parametrize(("width", "dark"), [(1100, False), (400, True)])
def test_the_page_fits_and_is_accessible(tmp_path: Path, serve: Serve, look: Open, width: int, dark: bool) -> None:
    """Health, reason, score, alarm and the unplugged device are there; nothing overflows; axe-core finds nothing."""
    fill(tmp_path / "history.db")
    down = SinkRow("zenoh", False, datetime.now(UTC) - timedelta(minutes=3), "nobody answers at tcp/router:7447")
    with closing(Store(tmp_path / "history.db", "arm1")) as store:
        store.add(SinkRows((down, SinkRow("can", True, datetime.now(UTC) - timedelta(hours=5), ""))))
    page = look(serve("--config", robot(tmp_path)).address, width=width, dark=dark)
    expect(page.locator("h1")).to_have_text("arm1")
    expect(page.locator("#sinks")).to_contain_text("zenohdown for 3 minnobody answers at tcp/router:7447")
    expect(page.locator("#sinks")).to_contain_text("canup for 5 h–")
    card = page.locator('[data-joint="elbow"].card')
    expect(card.locator('[data-field="health"]')).to_have_text("WARNING")
    reason = "play: 100% of the last 20 windows above the level"
    expect(card.locator('[data-field="reason"]')).to_contain_text(reason)
    expect(card.locator('[data-field="score"]')).to_have_text(re.compile(r"6\.9"))
    expect(card.locator('[data-field="severity"]')).to_have_text(re.compile(r"µm"))
    assert (card.locator(".spark path").get_attribute("d") or "").count("L") > 30
    expect(page.locator(".alarm")).to_contain_text("warning, active")
    expect(page.locator("#troubles")).to_contain_text("tip: nothing for 5 s; look at the cable at /dev/ttyUSB7")
    expect(page.locator("#unwatched")).to_be_visible()
    assert overflow(page) <= 0
    assert violations(page) == []


@pytest.mark.slow
def test_news_comes_while_the_page_is_open(tmp_path: Path, serve: Serve, look: Open) -> None:
    """A new score, a change of health and an alarm appear without anybody's doing."""
    fill(tmp_path / "history.db", count=40)
    page = look(serve("--config", robot(tmp_path)).address)
    page.locator("body[data-updated]").wait_for()
    store = Store(tmp_path / "history.db", "arm1")
    try:
        now = datetime.now(UTC)
        store.add(ScoreRow("elbow", now, 0.25, 77.25, 4.0, True))
        store.add(JointRow("elbow", Health.ERROR, "the play is large", now))
        store.add(raised("elbow", Cause.DEVICE, Severity.ERROR, "the sensor is loose", now))
        store.add(SinkRows((SinkRow("zenoh", False, now, "no session yet"),)))
        card = page.locator('[data-joint="elbow"].card')
        expect(card.locator('[data-field="score"]')).to_have_text(re.compile(r"77\.2"))
        expect(card.locator('[data-field="health"]')).to_have_text("ERROR")
        expect(card.locator(".fill.over")).to_have_attribute("width", "200.0")
        expect(page.locator(".alarm").first).to_contain_text("the sensor is loose")
        expect(page.locator("#sinks")).to_contain_text("no session yet")
        expect(page.locator("#unwatched")).to_be_hidden()
    finally:
        store.close()


@pytest.mark.slow
def test_an_acknowledgement_reaches_database_and_zenoh(
    tmp_path: Path, serve: Serve, look: Open, start: type[Running]
) -> None:
    """A running service raises an alarm, a person acknowledges it in the page; the keyboard alone does."""
    endpoint = free_endpoint()
    config = tmp_path / "fake.toml"
    alarms = 'statistic = "band"\nlevel = 0.5\n[alarm]\nwindows = 3\n'
    config.write_text(fake_config(tmp_path, f'{alarms}[alarm.zenoh]\nmode = "peer"\nlisten = ["{endpoint}"]\n'))
    start(config).wait_for("event=raised")
    heard: list[dict[str, object]] = []
    lock = threading.Lock()

    def hear(sample: object) -> None:
        with lock:
            heard.append(json.loads(sample.payload.to_string()))  # type: ignore[attr-defined]

    with zenoh_world.session("client", connect=[endpoint]) as session:
        session.declare_subscriber("lostmotion/fake/elbow/alarm", hear)
        # The fake driver is no driver of the installed program: the page gets the database.
        page = look(serve("--database", tmp_path / "history.db").address)
        button = page.locator('button[data-verb="ack"]').first
        button.focus()
        page.keyboard.press("Enter")
        expect(page.locator(".alarm")).to_contain_text("acknowledged")
        wait_until(lambda: any(one.get("event") == "acknowledged" for one in list(heard)))
    with open_readonly(tmp_path / "history.db") as reader:
        assert [alarm.state for alarm in reader.alarms("elbow", living=True)] == [AlarmState.ACKNOWLEDGED]
        assert any("web" in event.by for _, event in reader.transitions("elbow"))


@pytest.mark.slow
def test_shelving_without_a_service(tmp_path: Path, serve: Serve, look: Open) -> None:
    """Where no service runs the page does it itself, as the command line does."""
    fill(tmp_path / "history.db", count=40)
    page = look(serve("--config", robot(tmp_path)).address)
    page.locator("[data-hours]").select_option("24")
    page.locator('button[data-verb="shelve"]').click()
    expect(page.locator(".alarm")).to_contain_text("shelved until")
    page.locator('button[data-verb="unshelve"]').click()
    expect(page.locator(".alarm")).to_contain_text("active")


@pytest.mark.slow
def test_names_from_outside_are_text(tmp_path: Path, serve: Serve, look: Open) -> None:
    """A robot and a joint called like HTML are shown as they are called, before and after an event."""
    fill(tmp_path / "history.db", count=40, joint=HOSTILE, name=HOSTILE)
    site = serve("--database", tmp_path / "history.db")
    page = look(site.address)
    page.locator("body[data-updated]").wait_for()
    expect(page.locator("h1")).to_have_text(HOSTILE)
    assert page.locator("main img").count() == 0
    page.locator(".card h3 a").click()
    page.locator('#history[data-state="ready"] canvas').wait_for()
    assert page.locator("main img").count() == 0
    assert "owned" not in page.title().split("·")[-1]


@pytest.mark.slow
def test_the_database_goes_and_comes_back(tmp_path: Path, serve: Serve, look: Open) -> None:
    """Moved aside while the page is open: that is said; a new one is taken up."""
    database = tmp_path / "history.db"
    fill(database, count=40)
    page = look(serve("--config", robot(tmp_path)).address, complains=True)
    page.locator("body[data-updated]").wait_for()
    for ending in ("", "-wal", "-shm"):
        part = database.with_name(database.name + ending)
        if part.exists():
            shutil.move(part, part.with_name(f"old-{part.name}"))
    expect(page.locator("#banner")).to_contain_text("no database there")
    fill(database, count=50)
    expect(page.locator("#banner")).to_be_hidden()
    expect(page.locator('[data-joint="elbow"] [data-field="score"]')).to_have_text(re.compile(r"6\.88"))


@pytest.mark.slow
def test_the_server_goes_and_comes_back(tmp_path: Path, serve: Serve, look: Open) -> None:
    """A page whose server has ended says so."""
    fill(tmp_path / "history.db", count=40)
    site = serve("--config", robot(tmp_path))
    page = look(site.address, complains=True)
    page.locator("body[data-updated]").wait_for()
    site.close()
    expect(page.locator("#banner")).to_contain_text("lost")
