"""A joint's page: the history, and the window behind a point."""

from __future__ import annotations

import csv
import json
import re
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from playwright.sync_api import Page, expect

from lostmotion.daemon.reader import open_readonly
from lostmotion.daemon.records import ScoreRow
from lostmotion.daemon.store import Store
from lostmotion.drivers.recording import read_recording
from tests.daemon.cli_world import call
from tests.web.conftest import Open, Serve, Site, overflow, violations
from tests.web.world import F_RES_HZ, fill, robot


@pytest.fixture(scope="module")
def filled(tmp_path_factory: pytest.TempPathFactory, serve_all: Callable[[Path, Path], Site]) -> tuple[Site, datetime]:
    """A page of a year of wear, and when its last window was."""
    folder = tmp_path_factory.mktemp("robot")
    last = fill(folder / "history.db")
    return serve_all(folder, robot(folder)), last


def documents(site: Site, path: str) -> dict[str, object]:
    """An answer of the page's interface."""
    status, _, body = site.ask("GET", path)
    assert status == 200, body
    found: dict[str, object] = json.loads(body)
    return found


def ready(page: Page) -> None:
    """Waits until the history is drawn."""
    page.locator('#history[data-state="ready"] canvas').wait_for()


@pytest.mark.slow
@pytest.mark.parametrize(("width", "dark"), [(1100, False), (400, True)])
def test_the_page_fits_and_is_accessible(filled: tuple[Site, datetime], look: Open, width: int, dark: bool) -> None:
    """History, trend and newest window are there; nothing overflows; axe-core finds nothing."""
    page = look(f"{filled[0].address}/joints/elbow", width=width, dark=dark)
    ready(page)
    expect(page.locator("#trend")).to_contain_text("rising (p = ")
    expect(page.locator("#history-words")).to_contain_text("400 windows")
    expect(page.locator("#window-words")).to_contain_text("an impact")
    page.locator("#wave canvas").wait_for()
    page.locator("#spectrum canvas").wait_for()
    assert overflow(page) <= 0
    assert violations(page) == []


@pytest.mark.slow
def test_a_language_that_intl_does_not_know(filled: tuple[Site, datetime], look: Open) -> None:
    """A Chromium that is started without a locale calls its language en-US@posix: the history is drawn all the same."""
    named = "Object.defineProperty(Navigator.prototype, 'language', { get: () => 'en-US@posix' })"
    ready(look(f"{filled[0].address}/joints/elbow", before=named))


@pytest.mark.slow
def test_the_trend_is_told_as_in_the_terminal(filled: tuple[Site, datetime], look: Open) -> None:
    """The lines of ``lostmotion trend`` are those of the page, name and text, to the size in micrometres."""
    site, _ = filled
    text = call(
        "trend", "elbow", "--config", site.folder / "robot.toml", "--database", site.folder / "history.db"
    ).stdout
    expected = [(line[:15].strip(), line[15:]) for line in text.split("\n\n")[0].splitlines()[1:]]
    assert {"trend", "slope", "limit", "forecast", "wear"} <= dict(expected).keys()
    page = look(f"{site.address}/joints/elbow")
    expect(page.locator("#trend dt")).to_have_text([name for name, _ in expected])
    expect(page.locator("#trend dd")).to_have_text([told for _, told in expected])


def test_the_line_of_the_plot_is_that_since_the_wear_changed(filled: tuple[Site, datetime]) -> None:
    """It ends at the present value, from which the time until the limit follows."""
    found: Any = documents(filled[0], "/api/joints/elbow/trend")
    assert found["change_points"]
    assert found["recent_slope"] != found["slope"]
    line, last = found["line"], datetime.fromisoformat(found["last"]).timestamp()
    now = line["intercept"] + line["slope"] * (last - line["start"])
    assert now == pytest.approx(found["current"], rel=1e-6)


@pytest.mark.slow
def test_the_time_at_which_the_limit_is_reached_is_in_the_plot(tmp_path: Path, serve: Serve, look: Open) -> None:
    """The whole history is drawn beyond its end, as far as the forecast, where that begins within as long a time."""
    last = fill(tmp_path / "history.db")
    limits = "[alarm]\nseverity_warning = 0.004\nseverity_error = 0.008\n"
    site = serve("--config", robot(tmp_path, extra=limits))
    page = look(f"{site.address}/joints/elbow")
    expect(page.locator("#trend")).to_contain_text("forecast")
    ready(page)
    soon = documents(site, "/api/joints/elbow/trend")["forecast"]
    assert isinstance(soon, dict)
    until = float(page.locator("#history").get_attribute("data-until") or 0)
    assert last.timestamp() + soon["earliest_s"] < until
    for of in ("score", "severity"):
        page.locator(f'input[name="of"][value="{of}"]').check()
        ready(page)
        expect(page.locator("#history-words")).to_contain_text("400 windows")


@pytest.mark.slow
def test_drag_zooms_click_shows_keys_move(filled: tuple[Site, datetime], look: Open) -> None:
    """The mouse and the keyboard do the same: zoom, back to all, the window behind a point, two over each other."""
    page = look(f"{filled[0].address}/joints/elbow")
    ready(page)
    expect(page.locator("#window-words")).to_contain_text("an impact")
    expect(page.locator(".key li").first).to_have_text("trend")  # the lines that are not in the plot's own legend
    box = page.locator("#history .u-over").bounding_box()
    assert box is not None
    middle = box["y"] + box["height"] / 2
    page.mouse.move(box["x"] + 0.5 * box["width"], middle)
    page.mouse.down()
    page.mouse.move(box["x"] + 0.75 * box["width"], middle, steps=5)
    page.mouse.up()
    expect(page.locator("#history-words")).to_contain_text(re.compile(r"^(9\d|10\d) windows"))
    page.locator("#history").focus()
    page.keyboard.press("Home")
    expect(page.locator("#history-words")).to_contain_text("400 windows")
    page.locator("#hold").click()
    page.locator("#history .u-over").click(position={"x": 0.1 * box["width"], "y": 0.5 * box["height"]})
    expect(page.locator("#window-words")).to_contain_text("no impact")
    expect(page.locator("#window-words")).to_contain_text("Compared with:")
    page.locator('input[name="of"][value="score"]').check()
    ready(page)


@pytest.mark.slow
def test_series_keep_the_extremes(filled: tuple[Site, datetime]) -> None:
    """However few the pieces, the least and the largest score of all are among them, the median lies between them, and
    no window is counted twice."""
    site, _ = filled
    for pieces in (1, 7, 800):
        columns = documents(site, f"/api/joints/elbow/series?pieces={pieces}")["columns"]
        assert isinstance(columns, dict)
        assert min(columns["score_low"]) == 1.0
        assert max(columns["score_high"]) == pytest.approx(1 + 6 * 399 / 400)
        known = zip(columns["score_low"], columns["score_median"], columns["score_high"], strict=True)
        assert all(low <= median <= high for low, median, high in known)
        assert sum(columns["count"]) >= 399
        assert len(columns["count"]) <= pieces + 1


def test_a_short_motion_is_one_point_of_the_plot(tmp_path: Path) -> None:
    """Four windows within two seconds every ten days: wherever the boundaries of the pieces are, there are not two
    medians at one time."""
    begin = datetime(2026, 1, 1, tzinfo=UTC)
    store = Store(tmp_path / "history.db", "arm1")
    for day in range(0, 360, 10):
        for k in range(4):
            time = begin + timedelta(days=day, seconds=k / 2)
            store.add(ScoreRow("elbow", time, 0.25, 1.0 + k, 4.0, False, quality="ok"))
    store.close()
    with open_readonly(tmp_path / "history.db") as reader:
        for pieces in (71, 72, 144, 300, 720):
            rows = reader.extremes("elbow", begin + timedelta(seconds=1), begin + timedelta(days=360), pieces)
            assert len(rows) == 36
            assert {row[1] for row in rows[1:]} == {4}


def test_a_window_is_the_one_that_was_kept(tmp_path: Path, filled: tuple[Site, datetime]) -> None:
    """Its spectrum has its largest amplitude at the bar's line, within the mask; its download is a recording."""
    site, last = filled
    picture = documents(site, f"/api/joints/elbow/window?time={last.timestamp()}")["picture"]
    assert isinstance(picture, dict)
    peak = picture["frequency"][int(np.argmax(picture["amplitude"]))]
    (low, high) = picture["mask"][0]
    assert low <= F_RES_HZ <= high
    assert abs(peak - F_RES_HZ) <= 4.0
    status, headers, body = site.ask("GET", f"/api/joints/elbow/window?time={last.timestamp()}&format=csv")
    assert status == 200
    assert "attachment" in headers["content-disposition"]
    path = tmp_path / "window.csv"
    path.write_bytes(body)
    recording = read_recording(path)
    assert recording.number("f_res_hz", 0.0) == F_RES_HZ
    rows = list(csv.reader(line for line in body.decode().splitlines() if not line.startswith("#")))
    assert [float(row[2]) for row in rows[1:] if row[2]] == pytest.approx(picture["accel"], abs=1e-4)
    moments, angles = picture["commanded"]
    assert moments[0] == pytest.approx(-0.499)
    assert angles == pytest.approx(0.5 * np.cos(2 * np.pi * np.array(moments)), abs=1e-5)
    assert recording.signal("command")[1] == pytest.approx(angles, abs=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("path", "status", "words"),
    [
        ("/joints/nobody", 404, "no joint is called"),
        ("/api/joints/elbow/series?pieces=0", 422, "pieces"),
        ("/api/joints/elbow/series?pieces=1e9", 422, "pieces"),
        ("/api/joints/elbow/series?since=zzz", 422, "found the time"),
        ("/api/joints/elbow/series?since=1e300", 422, "found the time"),
        ("/api/joints/elbow/window?time=nan", 422, "found the time"),
        ("/no/such/page", 404, "Not Found"),
    ],
)
def test_bad_questions_get_a_sentence(filled: tuple[Site, datetime], path: str, status: int, words: str) -> None:
    """A status and what was found; never a traceback."""
    site, _ = filled
    found, _, body = site.ask("GET", path, accept="text/html")
    assert found == status
    assert words in body.decode()
    assert "Traceback" not in body.decode() + site.log


@pytest.mark.slow
def test_too_few_scores_for_a_trend_are_no_fault_of_the_server(tmp_path: Path, serve: Serve) -> None:
    """Two scores have no trend: it is not found, with the reason that the command line gives."""
    fill(tmp_path / "history.db", count=2)
    status, _, body = serve("--config", robot(tmp_path)).ask("GET", "/api/joints/elbow/trend")
    assert status == 404
    assert "found 2" in json.loads(body)["error"]
