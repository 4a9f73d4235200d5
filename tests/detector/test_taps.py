"""Recordings of several taps, with hum, gravity and a truth that is known."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest
from scipy import signal

from lostmotion.detector.errors import DetectorError
from lostmotion.detector.taps import find_taps, pooled, true_frequency
from lostmotion.detector.window import FloatArray
from tests.detector.synthetic import ring


def tapped(
    rng: np.random.Generator, rate: float, f_res: float, zeta: float, hum: float = 0.0, mains: float = 50.0
) -> tuple[np.ndarray, np.ndarray]:
    """Times and acceleration of 12 s with five taps of about 1 m/s², gravity, a slow sway, noise of 0.02 m/s²."""
    time = np.arange(0, 12, 1 / rate)
    starts = np.linspace(0.8, 9.4, 5) + rng.uniform(0, 0.6, 5)
    accel = rng.uniform(0.5, 1.5, 5) @ ring(time, starts, f_res, zeta)
    accel += 9.81 + 0.3 * np.sin(2 * math.pi * 0.3 * time) + rng.normal(0, 0.02, time.size)
    line = 2 * math.pi * (mains + rng.uniform(-0.05, 0.05)) * time
    return time, accel + hum * (np.sin(line + 1) + 0.3 * np.sin(2 * line))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("rate", "f_res", "zeta", "hum", "mains"),
    [
        (100.0, 35.0, 0.012, 0.0, 50.0),
        (100.0, 35.0, 0.012, 0.2, 60.0),
        (200.0, 58.0, 0.012, 0.5, 60.0),
        (200.0, 58.0, 0.005, 1.0, 50.0),
        (1000.0, 58.0, 0.025, 1.0, 60.0),
        (3200.0, 300.0, 0.006, 1.0, 50.0),
        (3200.0, 1100.0, 0.010, 0.2, 60.0),
    ],
)
def test_resonance_and_damping_through_hum(rate: float, f_res: float, zeta: float, hum: float, mains: float) -> None:
    """Every one of 4 recordings: f_res within 0.5 %, zeta within 10 %, both inside of intervals that are no wider."""
    rng = np.random.default_rng(7000 + int(rate + f_res))
    for _ in range(4):
        found = pooled([find_taps(*tapped(rng, rate, f_res, zeta, hum, mains))])
        assert found.f_res_hz.value == pytest.approx(f_res, rel=0.005)
        assert found.zeta.value == pytest.approx(zeta, rel=0.10)
        assert found.taps >= 1


def flicked(rng: np.random.Generator, f_res: float, zeta: float, wander: float, lost: float) -> tuple[FloatArray, ...]:
    """Times and acceleration of 12 s at 1 kHz of a bar that is flicked six times by half-sine forces of 1 to 4 ms,
    integrated at 8 kHz, with noise of 0.1 m/s².  The times wander by that [s], most of it in the first seconds, as
    those of a host that learns a sensor's clock; that share of the samples is lost."""
    fine, omega = np.arange(8 * 12_000) / 8000, 2 * math.pi * f_res
    force = np.zeros(fine.size)
    for begin in np.arange(1, 12, 2) + rng.uniform(-0.3, 0.3, 6):
        length = rng.uniform(1e-3, 4e-3)
        push = (fine >= begin) & (fine < begin + length)
        force[push] = rng.choice([-1, 1]) * rng.uniform(24, 60) * np.sin(math.pi * (fine[push] - begin) / length)
    up, down, _ = signal.cont2discrete(([1.0, 0, 0], [1, 2 * zeta * omega, omega**2]), 1 / 8000, "foh")
    accel = signal.lfilter(up.ravel(), down, force)[::8] + 0.98 + rng.normal(0, 0.1, 12_000)
    times = np.arange(12_000) / 1000
    slow = rng.normal(size=3) @ np.sin(2 * np.pi * rng.uniform(0.2, 1.0, (3, 1)) * times + rng.uniform(0, 6, (3, 1)))
    times = np.maximum.accumulate(times + wander * (slow / 2 + 2 * rng.normal() * np.exp(-times)))
    kept = rng.random(times.size) >= lost
    return times[kept] + 1e-9 * np.flatnonzero(kept), accel[kept]


@pytest.mark.slow
@pytest.mark.parametrize(("f_res", "wander", "lost"), [(None, 0.0, 0.0), (58.0, 0.0, 0.0), (None, 3e-4, 5e-4)])
def test_intervals_cover(f_res: float | None, wander: float, lost: float) -> None:
    """Of 120 bars 90 % of the intervals and more hold the truth, 99 % of both kinds at most, nearly all taps are found,
    and no hum, of which there is none: with even samples, with a bar near 60 Hz, and with times that wander and samples
    that are lost."""
    held, taps, hums = [], 0, 0
    for seed in range(120):
        rng = np.random.default_rng([7100, seed])
        truth, zeta = f_res or rng.uniform(30, 120), rng.uniform(0.006, 0.02)
        found = pooled([find_taps(*flicked(rng, truth, zeta, wander, lost))])
        held.append((found.f_res_hz.low <= truth <= found.f_res_hz.high, found.zeta.low <= zeta <= found.zeta.high))
        taps, hums = taps + found.taps, hums + (found.mains_hz is not None)
    assert np.mean(held, axis=0).min() >= 0.90
    assert np.mean(held) <= 0.99
    assert taps >= 0.97 * 6 * 120
    assert hums <= 2


def test_hum_is_named() -> None:
    """The mains frequency that was taken out, and none where there is none."""
    rng = np.random.default_rng(7200)
    assert find_taps(*tapped(rng, 1000.0, 58.0, 0.012, 0.5, 60.0)).mains_hz == 60.0
    assert find_taps(*tapped(rng, 1000.0, 58.0, 0.012, 0.5, 50.0)).mains_hz == 50.0
    assert find_taps(*tapped(rng, 200.0, 30.0, 0.012)).mains_hz is None


def test_holes_are_left_out() -> None:
    """A tap with missing samples is not used; the others are."""
    rng = np.random.default_rng(7300)
    time, accel = tapped(rng, 1000.0, 58.0, 0.012)
    keep = np.abs(time - 1.6) > 0.2
    found = pooled([find_taps(time[keep], accel[keep])])
    assert 3 <= found.taps <= 4
    assert found.f_res_hz.value == pytest.approx(58.0, rel=0.005)


def test_an_aliased_resonance_is_noticed() -> None:
    """145 Hz at 200 samples a second looks like 55 Hz with too much damping; a second rate decides."""
    rng = np.random.default_rng(7400)
    slow, other = find_taps(*tapped(rng, 200.0, 145.0, 0.012)), find_taps(*tapped(rng, 180.0, 145.0, 0.012))
    (warning,) = pooled([slow]).warnings
    assert "145" in warning
    assert "aliased" in warning
    (decided,) = pooled([slow, other]).warnings
    assert re.match(r"the bar rings at 14[45]\.\d Hz, of which 200 samples", decided)


def test_two_rates_that_agree_leave_no_doubt() -> None:
    """A resonance just below half of a rate is doubted, and no longer when another rate shows the same."""
    rng = np.random.default_rng(7500)
    near, far = find_taps(*tapped(rng, 125.0, 58.0, 0.012)), find_taps(*tapped(rng, 200.0, 58.0, 0.012))
    assert "near half of the rate" in pooled([near]).warnings[0]
    assert pooled([near, far]).warnings == ()


def test_true_frequency() -> None:
    """The lowest frequency that shows as each of the apparent ones; none when they contradict each other."""
    assert true_frequency([(50.0, 200.0), (30.0, 180.0)]) == pytest.approx(150.0)
    assert true_frequency([(58.0, 200.0), (58.0, 1000.0)]) == pytest.approx(58.0)
    assert true_frequency([(50.0, 200.0), (58.0, 1000.0)]) is None


def test_different_bars_are_refused() -> None:
    """Recordings of two bars at one rate have no common resonance."""
    rng = np.random.default_rng(7600)
    found = [find_taps(*tapped(rng, 500.0, f_res, 0.012)) for f_res in (58.0, 70.0)]
    with pytest.raises(DetectorError, match="different resonances"):
        pooled(found)


def test_few_missing_samples_cost_no_tap() -> None:
    """Single samples that are lost in every ring, one stamp that comes 2 ms late: all five taps are used."""
    rng = np.random.default_rng(7350)
    time, accel = tapped(rng, 1000.0, 58.0, 0.012)
    kept = np.arange(time.size) % 150 > 0
    time[2000:] += 0.002 * np.exp(-np.arange(time.size - 2000) / 1000)
    found = pooled([find_taps(time[kept], accel[kept])])
    assert found.taps == 5
    assert found.f_res_hz.low <= 58.0 <= found.f_res_hz.high


def test_no_tap_is_an_error() -> None:
    """Noise and hum alone hold no tap; three samples are no recording, nor is a tenth of a second."""
    rng = np.random.default_rng(7700)
    time = np.arange(0, 5, 1e-3)
    with pytest.raises(DetectorError, match="was the bar tapped"):
        find_taps(time, rng.normal(size=time.size) + np.sin(2 * math.pi * 50 * time))
    with pytest.raises(DetectorError, match="expected a recording"):
        find_taps(np.zeros(3), np.zeros(3))
    with pytest.raises(DetectorError, match=r"0\.1 s .* expected a recording"):
        find_taps(time[:100], rng.normal(size=100))
