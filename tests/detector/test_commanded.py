"""The commands as one smooth motion: closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from lostmotion.detector.commanded import MOST_POWERS, smoothed
from lostmotion.detector.window import Window

OMEGA = 2 * np.pi * 1.5


@pytest.mark.parametrize(("seconds", "by_powers"), [(0.45, True), (2.5, False)])
def test_a_sines_acceleration(seconds: float, by_powers: bool) -> None:
    """-w² times the angle, to a thousandth of its amplitude, whichever way the polynomials are made."""
    times, clock = np.arange(-0.2, seconds + 0.05, 0.01), np.arange(0.0, seconds, 1e-3)
    motion = smoothed(
        times, 0.3 * np.sin(OMEGA * times), Window("elbow", 0.0, seconds, clock, np.zeros(clock.size), 1e3)
    )
    assert motion is not None
    assert (motion.coefficients.size - 1 <= MOST_POWERS) == by_powers
    expected = -0.3 * OMEGA**2 * np.sin(OMEGA * clock)
    assert motion.acceleration(clock) == pytest.approx(expected, abs=0.3e-3 * OMEGA**2)
    assert motion.basis(clock) @ motion.coefficients == pytest.approx(0.3 * np.sin(OMEGA * clock), abs=1e-6)


def test_commands_in_bunches() -> None:
    """Twenty at a time, nothing between: the motion is followed where it was told."""
    times = np.concatenate([start + 1e-4 * np.arange(20) for start in (-0.15, 0.0, 0.15, 0.3, 0.45)])
    clock = np.arange(0.0, 0.45, 1e-3)
    motion = smoothed(times, 0.3 * np.sin(OMEGA * times), Window("elbow", 0.0, 0.45, clock, np.zeros(clock.size), 1e3))
    assert motion is not None
    assert motion.basis(times) @ motion.coefficients == pytest.approx(0.3 * np.sin(OMEGA * times), abs=1e-3)
