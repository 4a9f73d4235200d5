"""The report's small plots: ticks where a person wants them, points where the numbers say, gaps for what is missing."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET

import numpy as np
import pytest

from lostmotion.lab.report.plots import curve, heat_map, spectrum, stems
from lostmotion.lab.report.svg import Axis, Frame
from lostmotion.lab.report.views import Trace, amplitudes


@pytest.mark.parametrize(
    ("axis", "texts"),
    [
        (Axis("", 0.0, 10.0), ["0", "2", "4", "6", "8", "10"]),
        (Axis("", -0.031, 0.029), ["−0.03", "−0.02", "−0.01", "0.00", "0.01", "0.02"]),
        (Axis("", 3.0, 700.0, log=True), ["5", "10", "20", "50", "100", "200", "500"]),
        (Axis("", 1e-9, 2.0, log=True), ["10⁻⁸", "10⁻⁶", "10⁻⁴", "0.01", "1"]),
    ],
)
def test_ticks_are_round_numbers(axis: Axis, texts: list[str]) -> None:
    """1, 2 or 5 times a power of ten, no more than fit, in decades where there are many."""
    assert [text for _, text in axis.ticks()] == texts


def test_points_lie_where_the_numbers_say() -> None:
    """Corners of the data are corners of the frame, the middle of a decade is halfway to its root; NaN is left out."""
    frame = Frame(Axis("", 0.0, 1.0), Axis("", 1.0, 100.0, log=True), width=170, height=152)
    points = frame.points([0.0, 1.0, 0.5, np.nan], [1.0, 100.0, 10.0, 1.0])
    assert points.tolist() == [[58.0, 110.0], [158.0, 10.0], [108.0, 60.0]]


@pytest.mark.parametrize("values", [[], [np.nan], [3.0], [-1.0, 0.0]])
def test_axes_hold_whatever_there_is(values: list[float]) -> None:
    """No values, one value, or none that a logarithmic axis could show still give an axis with its low end below."""
    for log in (False, True):
        axis = Axis.around("", values, log=log)
        assert axis.low < axis.high
        assert axis.low > 0 or not log


def test_spectrum_shows_a_tone_at_its_height() -> None:
    """A tone of 50 Hz stands in the spectrum at 50 Hz with its power; white noise lies on the noise floor."""
    time = np.arange(8000) / 800
    noise = np.random.default_rng(1).normal(0, 0.1, time.size)
    tone = 2.0 * np.sin(2 * np.pi * 50 * time)
    found = amplitudes(Trace("r", "accel", time, tone + noise, tone, 0.1))
    assert found is not None
    assert found.frequency[np.argmax(found.measured)] == pytest.approx(50, abs=1)
    near = np.abs(found.frequency - 50) < 5
    assert np.sum(found.modelled[near] ** 2) * np.diff(found.frequency)[0] == pytest.approx(2.0, rel=0.02)
    assert np.sqrt(np.mean(found.residual**2)) == pytest.approx(found.noise, rel=0.05)
    assert found.noise == pytest.approx(0.1 * np.sqrt(2 / 800))
    assert amplitudes(Trace("r", "accel", time[:9], tone[:9], tone[:9], 0.1)) is None


def test_pictures_are_well_formed_and_labelled() -> None:
    """Each is valid XML with its title escaped, its axes in human units, and no number that is not finite."""
    x, y = np.linspace(-0.2, 0.2, 9), np.full(9, 1e-4)
    lag = np.arange(1.0, 6.0)
    tone = np.sin(lag)
    pictures = {
        "curve": curve("a < b & c", x, y, y - 5e-5, y + 5e-5, ("the joint's angle", "left"), ("rad", "N m")),
        "stems": stems("own past", lag, tone, 0.1),
        "heat": heat_map(["d", "x<y"], np.array([[1.0, -0.97], [-0.97, 1.0]])),
        "flat": curve("flat", x, 0 * y, 0 * y, np.full(9, np.nan), ("time", "left"), ("s", "m")),
    }
    time = np.arange(100) / 100
    still = amplitudes(Trace("still", "accel", time, 0 * time, 0 * time, np.nan))
    assert still is not None
    pictures["still"] = spectrum(still)
    for picture in pictures.values():
        ET.fromstring(picture)
        assert not re.search(r'nan|inf|d="M[Z"]', picture)
    assert "a &lt; b &amp; c" in pictures["curve"]
    assert "the joint&#x27;s angle (°)" in pictures["curve"]
    assert "left (mN m)" in pictures["curve"]
    assert "−.97" in pictures["heat"]
