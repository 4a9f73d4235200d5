"""Lever arms and delays from sums of sines, whose derivatives are written down."""

from __future__ import annotations

import math

import numpy as np
import pytest

from lostmotion.detector.lever import delay, levers
from lostmotion.detector.window import FloatArray

ARMS, GRAVITY, NOISE = (0.12, -0.05, 0.0), 9.81, 0.3


def moved(late: float, *hz: float) -> tuple[FloatArray, FloatArray, list[tuple[FloatArray, FloatArray]]]:
    """Readings at 1 kHz over 4 s, so much later [s] than the angles of three joints at 100 Hz; of frequencies of their
    own, or of one that all have."""
    random = np.random.default_rng(5)
    times, at = np.arange(2.0, 6.0, 1e-3), np.arange(0.5, 7.5, 0.01)
    accel, joints = GRAVITY + NOISE * random.standard_normal(times.size), []
    for arm in ARMS:
        rates = 2 * math.pi * np.array(hz or random.uniform(0.5, 2.2, 5))
        phases = random.uniform(0, 2 * math.pi, rates.size)
        joints.append((at, 0.2 * np.sin(np.outer(at, rates) + phases).sum(axis=1)))
        accel -= arm * 0.2 * (rates**2 * np.sin(np.outer(times - late, rates) + phases)).sum(axis=1)
    return times, accel, joints


def test_levers_are_found() -> None:
    """Three arms, one of which does not move the sensor; second differences over 20 ms are off by 5 %."""
    times, accel, joints = moved(0.0)
    found = levers(times, accel, joints)
    assert found is not None
    for lever, arm in zip(found, ARMS, strict=True):
        assert lever.value == pytest.approx(arm, abs=3e-3)
        assert lever.error < 1e-3
        assert 5.0 < lever.motion < 30.0


@pytest.mark.parametrize("late", [-0.72, -0.4, 0.2, 0.36, 0.8])
def test_a_delay_is_found(late: float) -> None:
    """Readings that come too late, or too early."""
    assert delay(*moved(late)) == pytest.approx(late, abs=0.021)


def test_usual_delays_and_periodic_motions_have_none() -> None:
    """A servo that lags is usual; one sine fits at every period."""
    assert delay(*moved(0.08)) == 0.0
    assert delay(*moved(0.5, 2.0)) == 0.0
