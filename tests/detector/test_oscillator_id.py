"""Resonance and damping from taps whose truth is known."""

from __future__ import annotations

import math

import numpy as np
import pytest

from lostmotion.detector.errors import DetectorError
from lostmotion.detector.oscillator_id import identify
from tests.detector.synthetic import ring


def tap(rng: np.random.Generator, rate: float, f_res: float, zeta: float, noise: float) -> np.ndarray:
    """4 s with gravity, a swaying arm and one tap of unit size at about 1 s."""
    time = np.arange(0, 4, 1 / rate)
    start = rng.uniform(0.5, 1.5, 1)
    sway = 0.5 * np.sin(2 * math.pi * 0.7 * time) + 0.98
    return np.asarray(ring(time, start, f_res, zeta)[0] + sway + rng.normal(0, noise, time.size))


@pytest.mark.parametrize(("rate", "noise"), [(200.0, 0.02), (1000.0, 0.05)])
@pytest.mark.parametrize(("f_res", "zeta"), [(58.0, 0.012), (58.0, 0.005), (35.0, 0.02), (80.0, 0.008)])
def test_f_res_within_half_a_percent_and_zeta_within_ten(rate: float, noise: float, f_res: float, zeta: float) -> None:
    """Every one of 20 taps."""
    rng = np.random.default_rng(60)
    for _ in range(20):
        found = identify(tap(rng, rate, f_res, zeta, noise), rate)
        assert found.f_res_hz == pytest.approx(f_res, rel=0.005)
        assert found.zeta == pytest.approx(zeta, rel=0.10)


def test_no_bias() -> None:
    """Over 100 taps the mean errors are below 0.02 % and 1 %."""
    rng = np.random.default_rng(61)
    found = [identify(tap(rng, 1000.0, 58.0, 0.012, 0.05), 1000.0) for _ in range(100)]
    assert np.mean([o.f_res_hz for o in found]) == pytest.approx(58.0, rel=2e-4)
    assert np.mean([o.zeta for o in found]) == pytest.approx(0.012, rel=0.01)


def test_no_tap_is_an_error() -> None:
    """Noise alone has no resonance."""
    with pytest.raises(DetectorError, match="was the bar tapped"):
        identify(np.random.default_rng(62).normal(size=4000), 1000.0)


@pytest.mark.parametrize(
    ("accel", "words"),
    [(np.zeros(10), "samples: found 10, 0 of them missing"), (np.full(100, np.nan), "100 of them missing")],
)
def test_too_little_is_an_error(accel: np.ndarray, words: str) -> None:
    """Short recordings and recordings with holes are refused."""
    with pytest.raises(DetectorError, match=words):
        identify(accel, 1000.0)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("value", [0.0, 9.81])
def test_a_sensor_that_stands_still_is_an_error(value: float) -> None:
    """A constant reading has no resonance."""
    with pytest.raises(DetectorError, match="all 1000 samples are"):
        identify(np.full(1000, value), 200.0)


def test_a_short_ring_is_an_error() -> None:
    """A bar with a damping of 0.2 does not ring long enough."""
    with pytest.raises(DetectorError, match="cycles"):
        identify(tap(np.random.default_rng(63), 1000.0, 58.0, 0.2, 0.001), 1000.0)
