"""The words for what is wrong with a window."""

from __future__ import annotations

import math

import numpy as np
import pytest

from lostmotion.detector.quality import describe, mended
from lostmotion.detector.score import score_window
from lostmotion.detector.window import DetectorSettings, Window

TIME = np.arange(250) / 1000
NOISE = np.random.default_rng(8).normal(0, 0.1, 250)
RING = 5 * np.exp(-4.4 * TIME) * np.sin(2 * np.pi * 58 * TIME) + NOISE


def window(accel: np.ndarray, excitation: float = math.nan) -> Window:
    """A window of those samples at 1 kHz."""
    return Window("elbow", 0.0, accel.size / 1000, np.arange(accel.size) / 1000, accel, 1000.0, excitation)


def without(*places: slice) -> np.ndarray:
    """The ring without the samples of some places."""
    accel = RING.copy()
    for place in places:
        accel[place] = np.nan
    return accel


@pytest.mark.parametrize(
    ("accel", "excitation", "words"),
    [
        (RING, 20.0, "ok"),
        (RING, math.nan, "ok"),
        (np.round(2 * np.sin(2 * np.pi * 1.5 * TIME) / 0.05) * 0.05, 20.0, "ok"),  # slow, in coarse steps
        (without(slice(200, 250)), 20.0, "short"),
        (without(slice(0, 30)), 20.0, "short"),
        (without(slice(50, 60)), 20.0, "gappy"),
        (without(slice(50, 60), slice(230, 250)), 20.0, "short,gappy"),
        (np.clip(RING, -3, 3), 20.0, "clipped"),
        (np.full(250, 9.81), 20.0, "flat"),
        (RING, 0.1, "gentle"),
        (np.full(250, np.nan), 20.0, "short"),
        (np.empty(0), 20.0, "short"),
    ],
)
def test_quality(accel: np.ndarray, excitation: float, words: str) -> None:
    """Each defect is named, together with the others, and a good window is ok."""
    assert describe(window(accel, excitation)) == words


def test_samples_at_the_sensors_range_are_clipped() -> None:
    """One sample at the range of the sensor is enough."""
    assert describe(window(RING, 20.0), range_ms2=float(np.abs(RING).max())) == "clipped"
    assert describe(window(RING, 20.0), range_ms2=16 * 9.81) == "ok"


def test_mended_draws_straight_lines() -> None:
    """Missing samples lie on the line between their neighbours; at the ends the nearest sample is repeated."""
    nan = math.nan
    assert list(mended(np.array([nan, 1.0, nan, nan, 4.0, nan]))) == [1.0, 1.0, 2.0, 3.0, 4.0, 4.0]


def test_what_is_gentle_is_set_by_the_settings() -> None:
    """A window of 20 rad/s² is gentle where calibration found that 25 are needed, and its score is marked so."""
    assert describe(window(RING, 20.0), gentle=25.0) == "gentle"
    assert score_window(window(RING, 20.0), DetectorSettings(f_res_hz=58.0, gentle=25.0)).quality == "gentle"
    assert score_window(window(RING, 20.0), DetectorSettings(f_res_hz=58.0)).quality == "ok"


@pytest.mark.parametrize(("excitation", "words"), [(20.0, "implausible"), (0.1, "implausible,gentle")])
@pytest.mark.parametrize("accel", [1e6 * (1 + TIME), 1e300 * RING])
def test_a_window_without_noise_is_implausible(accel: np.ndarray, excitation: float, words: str) -> None:
    """A clock's column rises evenly, and some values are beyond all numbers when squared: no score, and no evidence."""
    score = score_window(window(accel, excitation), DetectorSettings(f_res_hz=58.0))
    assert (score.quality, math.isnan(score.score)) == (words, True)
