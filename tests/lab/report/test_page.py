"""The report: one file that loads nothing, holds what it was given, and works in a browser."""

from __future__ import annotations

import base64
import json
import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lostmotion.detector.oscillator_id import Oscillator
from lostmotion.drivers.errors import RecordingError
from lostmotion.lab.report import write_report
from lostmotion.lab.report.signals import packed, signals
from lostmotion.lab.report.tags import p_value, probability
from lostmotion.lab.report.views import Trace
from tests.conftest import CHROMIUM
from tests.lab import report_example

TITLE = 'Elbow </script><script>alert("1")</script> & arm'
VOID = {"meta", "link", "br", "img", "input", "hr"}


class Page(HTMLParser):
    """A page's elements: ids of sections, text, attributes that could load something; asserts that tags are closed."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.sections: list[str] = []
        self.loads: list[str] = []
        self.count: dict[str, int] = {}
        self.texts: list[str] = []
        self.data = ""
        self.feed(text)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Counts it, and remembers what it would load."""
        given = dict(attrs)
        self.count[tag] = self.count.get(tag, 0) + 1
        if tag == "section":
            self.sections.append(given["id"] or "")
        self.loads += [value for key, value in attrs if value and key in ("src", "href", "xlink:href", "data", "action")
                       and not value.startswith("#")]  # fmt: skip
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """SVG's empty elements."""
        self.count[tag] = self.count.get(tag, 0) + 1

    def handle_endtag(self, tag: str) -> None:
        """Closes the last that was opened."""
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        """The JSON apart from the text."""
        if self.open and self.open[-1] == "script":
            self.data = self.data or data
        elif not self.open or self.open[-1] != "style":
            self.texts.append(data)

    @property
    def text(self) -> str:
        """All that is read."""
        return " ".join(self.texts)

    @property
    def signals(self) -> list[dict[str, Any]]:
        """What the script draws."""
        return list(json.loads(self.data))


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The report of an explanation with all there is."""
    path = tmp_path_factory.mktemp("report") / "elbow.html"
    write_report(
        path, title=TITLE, explanation=report_example.explanation(), tap=Oscillator(58.02, 0.0123, 23.0, 0.02, 3e-4)
    )
    return path


@pytest.fixture(scope="module")
def compared(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The report of the rubbing joint against a model without friction."""
    path = tmp_path_factory.mktemp("report") / "compared.html"
    write_report(path, comparison=report_example.comparison())
    return path


def read(path: Path) -> Page:
    """A report, parsed."""
    return Page(path.read_text(encoding="utf-8"))


def test_sections_are_those_of_what_was_given(found: Path, tmp_path: Path) -> None:
    """An explanation fills its sections in order; a fit, a ladder, something unexplained others; nothing fills none."""
    tail = ["model", "parameters", "correlations"]
    assert read(found).sections == ["verdict", "advice", "signals", "spectra", "ranking", *tail, "tap"]
    given: list[tuple[dict[str, Any], list[str]]] = [
        ({"fit": report_example.fit()}, ["verdict", "signals", "spectra", *tail]),
        ({"ladder": report_example.ladder()},
         ["verdict", "ladder", "advice", "signals", "spectra", "ranking", *tail]),
        ({"explanation": report_example.nothing_missing()},
         ["verdict", "signals", "spectra", "ranking", "detectable", *tail]),
        ({"explanation": report_example.outside_catalogue()}, ["verdict", "signals", "left", "spectra", *tail]),
        ({}, []),
    ]  # fmt: skip
    for results, sections in given:
        write_report(tmp_path / "one.html", **results)
        assert read(tmp_path / "one.html").sections == sections


def test_a_comparison_tells_where_the_model_fails(compared: Path, tmp_path: Path) -> None:
    """When, in which states and at which frequencies; the states that matter in sight, the others behind a tap."""
    page, comparison = read(compared), report_example.comparison()
    where = ["errors", "time", "maps", "spectra", "lags"]
    assert page.sections == ["verdict", "signals", *where, "model"]
    telling = sum(one.significant for one in comparison.columns["accel"].maps)
    assert 0 < telling < len(comparison.columns["accel"].maps)
    assert f"{len(comparison.columns['accel'].maps) - telling} that show nothing beyond chance" in page.text
    assert f"the noise is {comparison.columns['accel'].noise.rms:.2f}." in page.text
    worst = comparison.worst_phase("accel")
    assert f"The error is largest {worst.phase}: " in page.text
    assert page.count["svg"] == 2 * (3 + len(comparison.columns["accel"].maps) + 3 + 3)  # each with an inner one
    residual = np.frombuffer(base64.b64decode(page.signals[0]["modelled"]), "<f4")
    assert np.array_equal(residual, comparison.overlays[0].modelled.astype("f4"))
    write_report(tmp_path / "all.html", comparison=report_example.comparison("coulomb_friction"),
                 explanation=report_example.explanation())  # fmt: skip
    both = ["verdict", "advice", "signals", *where, "ranking", "model", "parameters", "correlations"]
    assert read(tmp_path / "all.html").sections == both


def test_it_loads_nothing(found: Path) -> None:
    """No element points outside of the file, and the only addresses in it are those of licences."""
    text = found.read_text(encoding="utf-8")
    assert read(found).loads == []
    assert set(re.findall(r"https?://[^\s\"'<>]+", text)) <= {"https://github.com/leeoniya/uPlot"}
    assert "@import" not in text
    assert "url(" not in text
    assert "default-src 'none'" in text
    assert "Copyright (c) 2022 Leon Sorokin" in text


def test_names_cannot_break_out(found: Path) -> None:
    """Tags in a title or in the name of a recording are text; the page has its own two script elements only."""
    page = read(found)
    assert TITLE in page.text
    assert page.count["script"] == 2
    assert "alert" not in page.data
    assert f"Acceleration, 0 {report_example.NAME}" in page.text


def test_headline_and_tables_tell_the_results(found: Path) -> None:
    """The engineer's sentence, the advice, effects that were tried, parameters with intervals, what cannot be told."""
    text = read(found).text
    for said in (
        "Something rubs: Coulomb friction of 0.120 mN m, between 0.112 and 0.128 (95 %).",
        "Adding it brings the error from 4.1 to 0.41 m/s²; the sensor's noise is 0.40.",
        "Move it by hand without power",
        "a sine of 0.5 Hz, 5°.",
        "hardening_spring",
        "<\u00a00.003",
        "-tau_c sign(omega)",
        "74 … 86",
        "Not identifiable from these recordings: alpha; take the values as assumed.",
        "alpha with d (−0.97)",
        "Resonance 58.02 Hz, damping ratio 0.0123, from 23 cycles",
    ):
        assert said in text, said


def test_samples_arrive_unchanged(found: Path) -> None:
    """Every measured sample is in the file in single precision, each column on its own times, with the noise."""
    signals = read(found).signals
    assert [one["what"] for one in signals] == ["acceleration", "angle"] * 3
    accel, angle = signals[:2]
    recording = report_example.recordings()[0]
    sent = np.frombuffer(base64.b64decode(accel["measured"]), "<f4")
    assert np.array_equal(sent, recording.columns["accel"].astype("f4"))
    assert (accel["start"], accel["spacing"], accel["count"]) == (0.0, pytest.approx(1 / 800), 3200)
    assert (accel["unit"], accel["noise"]) == ("m/s²", report_example.NOISE)
    degrees = np.rad2deg(recording.columns["position"][::4])
    assert np.allclose(np.frombuffer(base64.b64decode(angle["measured"]), "<f4"), degrees, rtol=1e-6)
    assert (angle["unit"], angle["residual_unit"], angle["count"], angle["noise"]) == ("°", "′", 800, None)


def test_uneven_times_are_sent_in_full(tmp_path: Path) -> None:
    """Times off a grid keep their double precision."""
    fit = report_example.fit()
    experiment = fit.experiments[0]
    keep = np.delete(np.arange(experiment.time.size), 7)
    measured = {name: values[keep] for name, values in experiment.measured.items()}
    uneven = replace(experiment, time=experiment.time[keep], measured=measured)
    write_report(tmp_path / "r.html", fit=replace(fit, experiments=(uneven,), starts=fit.starts[:1]))
    accel = read(tmp_path / "r.html").signals[0]
    assert np.array_equal(np.frombuffer(base64.b64decode(accel["time"]), "<f8"), uneven.time)


def test_file_is_small(found: Path) -> None:
    """Three recordings of 4 s at 800 Hz take less than 0.4 MB, the drawing library included."""
    assert found.stat().st_size < 400_000


def test_a_report_is_replaced_at_once_or_not_at_all(tmp_path: Path) -> None:
    """A folder that is not there is one line of error; nothing half-written is left."""
    with pytest.raises(RecordingError, match="cannot be written"):
        write_report(tmp_path / "no" / "r.html", fit=report_example.fit())
    write_report(tmp_path / "r.html")
    assert [path.name for path in tmp_path.iterdir()] == ["r.html"]


@contextmanager
def browser(path: Path, before: str = "", **options: Any) -> Iterator[Any]:
    """The report in a headless Chromium, and a check that it complained of nothing and asked nobody for anything.

    before: a script that runs before those of the report.
    """
    playwright = pytest.importorskip("playwright.sync_api", reason="needs Playwright for Python")
    if not CHROMIUM.exists():
        pytest.skip(f"needs {CHROMIUM}")
    with playwright.sync_playwright() as driver:
        chromium = driver.chromium.launch(executable_path=str(CHROMIUM), args=["--no-sandbox"])
        page = chromium.new_page(locale="en-GB", **options)
        page.add_init_script(before)
        complaints: list[str] = []
        requests: list[str] = []
        page.on("console", lambda message: complaints.append(message.text))
        page.on("pageerror", lambda error: complaints.append(str(error)))
        page.on("request", lambda request: requests.append(request.url))
        page.goto(path.as_uri())
        yield page
        assert complaints == []
        assert requests == [path.as_uri()]
        chromium.close()


def shows(page: Any, low: float, high: float, tolerance: float = 0.03) -> bool:
    """Whether both plots of the first recording show that segment [s], at the latest after two seconds."""
    for _ in range(100):
        ranges = page.evaluate("lostmotion.charts[0].plots.map((p) => [p.scales.x.min, p.scales.x.max])")
        if np.allclose(ranges, [[low, high]] * 2, atol=tolerance, rtol=0):
            return True
        page.wait_for_timeout(20)
    return False


@pytest.mark.slow
def test_zoom_and_pan_in_a_browser(found: Path) -> None:
    """Drag, buttons, keys, wheel and double-click move overlay and residual together, never beyond the recording."""
    with browser(found, viewport={"width": 1000, "height": 1400}) as page:
        page.wait_for_selector("#signal-0 .u-over")
        signal, last = page.locator("#signal-0"), 3199 / 800
        assert shows(page, 0.0, last, 1e-6)
        box = page.locator("#signal-0 .u-over").first.bounding_box()
        middle = box["y"] + box["height"] / 2
        page.mouse.move(box["x"] + 0.25 * box["width"], middle)
        page.mouse.down()
        page.mouse.move(box["x"] + 0.5 * box["width"], middle + 3, steps=4)
        page.mouse.up()
        assert shows(page, 1.0, 2.0)
        page.locator('#signal-0 button[data-do="in"]').click()
        assert shows(page, 1.25, 1.75)
        signal.press("ArrowRight")
        assert shows(page, 1.375, 1.875)
        for _ in range(20):
            signal.press("ArrowLeft")
        assert shows(page, 0.0, 0.5)
        for _ in range(20):
            signal.press("+")
        assert shows(page, 0.25, 0.25)
        assert page.evaluate("lostmotion.charts[0].range[1] - lostmotion.charts[0].range[0]") > 3.9 / 800
        page.mouse.dblclick(box["x"] + 50, middle)
        assert shows(page, 0.0, last, 1e-6)
        page.keyboard.down("Control")
        page.mouse.wheel(0, -100)
        page.keyboard.up("Control")
        assert shows(page, 50 / box["width"] * last * 0.2, last * (0.8 + 0.2 * 50 / box["width"]))


@pytest.mark.slow
def test_a_language_that_intl_does_not_know(found: Path) -> None:
    """A Chromium that is started without a locale calls its language en-US@posix: the report is drawn all the same."""
    named = "Object.defineProperty(Navigator.prototype, 'language', { get: () => 'en-US@posix' })"
    with browser(found, before=named) as page:
        page.wait_for_selector("#signal-0 .u-over")


@pytest.mark.slow
@pytest.mark.parametrize("options", [
    {"viewport": {"width": 360, "height": 740}, "color_scheme": "dark", "has_touch": True, "is_mobile": True},
    {"viewport": {"width": 1280, "height": 900}, "color_scheme": "light"},
], ids=["phone", "desk"])  # fmt: skip
def test_page_fits_its_screen(found: Path, options: dict[str, Any]) -> None:
    """Nothing sticks out to the side on a phone or a desk, and the text stands out from the page, light and dark."""
    with browser(found, **options) as page:
        page.wait_for_selector("#signal-0 .u-over")
        assert page.evaluate("document.documentElement.scrollWidth") <= options["viewport"]["width"]
        colours = page.evaluate(
            "[getComputedStyle(document.body).color, getComputedStyle(document.body).backgroundColor]"
        )
        text, ground = (sum(map(int, re.findall(r"\d+", colour)[:3])) for colour in colours)
        assert (text > ground) == (options["color_scheme"] == "dark")
        assert abs(text - ground) > 500


@pytest.mark.slow
def test_print_shows_all_recordings(found: Path, tmp_path: Path) -> None:
    """On paper every recording is drawn, also those that were not yet scrolled to."""
    with browser(found) as page:
        page.wait_for_selector("#signal-0 .u-over")
        page.pdf(path=str(tmp_path / "r.pdf"))
        assert page.evaluate("lostmotion.charts.length") == 6
        assert page.evaluate("document.documentElement.className") == ""
    assert (tmp_path / "r.pdf").stat().st_size > 50_000


def test_residuals_of_a_column_have_one_unit() -> None:
    """An angle that is off by 0.03 mrad in one recording and by 3 in another: both in degrees, as text and curves."""
    time = np.arange(50) / 50
    traces = [Trace(name, "position", time, np.full(50, size), np.zeros(50), 1e-5)
              for name, size in (("a.csv", 3e-5), ("b.csv", 3e-3))]  # fmt: skip
    page = signals(traces)
    assert [text for text in ("0.0017°", "0.17°") if f"error {text}" not in page.body] == []
    assert {one["residual_unit"] for one in json.loads(packed(traces))} == {"°"}


@pytest.mark.parametrize(
    ("value", "text"), [(0.5, "= 0.50"), (0.0123, "= 0.012"), (0.001, "< 0.003"), (np.nan, "unknown")]
)
def test_a_probability_in_a_sentence_and_in_a_table(value: float, text: str) -> None:
    """Below the head "p" stands the number alone; a sentence has the sign, too."""
    assert p_value(value).replace("\u00a0", " ") == f"p {text}"
    assert probability(value).replace("\u00a0", " ") == text.removeprefix("= ")
