"""How long a window is, and how it is cut from a stream."""

from __future__ import annotations

import math

import numpy as np
import pytest

from lostmotion.detector.window import DetectorSettings
from lostmotion.detector.windows import cut, window_length


@pytest.mark.parametrize(
    ("zeta", "expected"),
    [(0.012, 0.05 + 1.2564 / (2 * math.pi * 0.012 * 58)), (0.002, 0.5), (0.05, 2.5 / 12)],
)
def test_window_fits_the_oscillator(zeta: float, expected: float) -> None:
    """Unset: the impact's delay and 1.26 time constants, between 2.5 / f_width and 0.5 s, in whole samples."""
    settings = DetectorSettings(f_res_hz=58.0, zeta=zeta, window_s=None)
    length = window_length(settings, 1000.0)
    assert length == pytest.approx(expected, abs=0.0005)
    assert length * 1000 == round(length * 1000)


def test_window_length_of_the_settings_holds() -> None:
    """A length that is set is kept, rounded to a sample."""
    assert window_length(DetectorSettings(f_res_hz=58.0, window_s=0.25), 200.0) == 0.25
    assert window_length(DetectorSettings(f_res_hz=58.0, window_s=0.251), 200.0) == 0.25


def test_ring_down_is_longest_heard_after_1_26_time_constants() -> None:
    """BEST_RATIO maximises amplitude over noise, (1 - exp(-x)) / sqrt(x)."""
    ratio = np.linspace(0.5, 3, 100001)
    assert ratio[np.argmax((1 - np.exp(-ratio)) / np.sqrt(ratio))] == pytest.approx(1.2564, abs=1e-3)


def test_cut_takes_the_samples_of_its_stretch() -> None:
    """From 2.0013 s, 0.25 s at 200 Hz: the 50 samples from 2.0025 s on, at their own times."""
    times = 0.0025 + np.arange(1000) / 200
    window = cut("elbow", times, np.arange(1000.0), 2.0013, 0.25, 200.0, excitation=3.0, temperature=40.0)
    assert list(window.accel) == list(np.arange(400.0, 450.0))
    assert window.time == pytest.approx(times[400:450])
    assert (window.joint, window.start, window.duration, window.rate_hz) == ("elbow", 2.0013, 0.25, 200.0)
    assert (window.excitation, window.temperature) == (3.0, 40.0)


@pytest.mark.parametrize("start", np.linspace(1.0, 1.005, 11))
def test_cut_survives_jitter_and_loss(start: float) -> None:
    """1 ms of jitter at 200 Hz moves no sample to another place, and each lost one is one NaN."""
    rng = np.random.default_rng(7)
    place = np.arange(600)
    times = place / 200 + rng.uniform(-1e-3, 1e-3, 600)
    keep = np.ones(600, dtype=bool)
    keep[[210, 211, 230]] = False
    window = cut("elbow", times[keep], place[keep].astype(float), start, 0.25, 200.0)
    there = np.isfinite(window.accel)
    first = window.accel[there][0] - np.flatnonzero(there)[0]
    assert window.accel.size == 50
    assert (~there).sum() == 3
    assert np.array_equal(window.accel[there], first + np.flatnonzero(there))
    assert abs(first / 200 - start) <= 0.0027


def test_cut_beyond_the_stream_is_missing() -> None:
    """What the stream does not reach is NaN, and a stream elsewhere leaves nothing but NaN."""
    times = np.arange(100) / 1000
    half = cut("elbow", times, np.ones(100), 0.05, 0.1, 1000.0)
    assert np.isfinite(half.accel).sum() == 50
    assert np.isnan(half.accel[50:]).all()
    assert np.isnan(cut("elbow", times, np.ones(100), 5.0, 0.1, 1000.0).accel).all()
    assert cut("elbow", np.empty(0), np.empty(0), 5.0, 0.1, 1000.0).accel.size == 100
