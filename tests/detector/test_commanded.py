"""The commands as one smooth motion: closed forms."""

from __future__ import annotations

import math
from itertools import product

import numpy as np
import pytest
from bench.joints import motion_of

from lostmotion.detector.commanded import MOST_POWERS, smoothed
from lostmotion.detector.servo import DAMPING, DELAYS, ORDERS, PURE, ServoLaw
from lostmotion.detector.window import Window

OMEGA = 2 * np.pi * 1.5


@pytest.mark.parametrize(("seconds", "by_powers"), [(0.2, True), (0.45, False), (2.5, False)])
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
    assert motion.basis(clock) @ motion.coefficients == pytest.approx(0.3 * np.sin(OMEGA * clock), abs=3e-6)


def test_commands_in_bunches() -> None:
    """Twenty at a time, nothing between: the motion is followed where it was told."""
    times = np.concatenate([start + 1e-4 * np.arange(20) for start in (-0.15, 0.0, 0.15, 0.3, 0.45)])
    clock = np.arange(0.0, 0.45, 1e-3)
    motion = smoothed(times, 0.3 * np.sin(OMEGA * times), Window("elbow", 0.0, 0.45, clock, np.zeros(clock.size), 1e3))
    assert motion is not None
    assert motion.basis(times) @ motion.coefficients == pytest.approx(0.3 * np.sin(OMEGA * times), abs=1e-3)


@pytest.mark.parametrize("kind", ["hand", "sines10", "trapezoid", "least-jerk"])
def test_errors_of_quantised_commands(kind: str) -> None:
    """Commands in steps of 0.29° at 100 Hz: the error is 0.4 to 1.1 mrad, and 0.6 to 1.15 of its standard deviation,
    whether the motion reaches 3 or 10 Hz, jerks or stands."""
    step, clock = np.radians(300) / 1023, np.arange(0.0, 0.45, 2.5e-3)
    errors, shares = [], []
    for seed, start in product(range(40, 43), np.arange(1.0, 11.0, 0.7)):
        moved = motion_of(kind, seed)
        times = np.arange(start - 0.2, start + 0.5, 0.01)
        window = Window("elbow", start, 0.45, start + np.arange(450) / 1e3, np.zeros(450), 1e3)
        motion = smoothed(times, np.round(moved.position(times) / step) * step, window)
        assert motion is not None
        basis = motion.basis(clock)
        error = basis @ motion.coefficients - moved.position(start + clock)
        errors.append(error)
        shares.append(error / np.sqrt(np.sum((basis @ motion.covariance) * basis, axis=1)))
    assert 4e-4 < np.sqrt(np.mean(np.square(errors))) < 1.1e-3
    assert 0.6 < np.sqrt(np.mean(np.square(shares))) < 1.15


@pytest.mark.parametrize("order", [0, 1, 2, 3, 4])
def test_a_slow_servo(order: int) -> None:
    """A sine that a servo follows 20 ms late, by a pure delay or a lag of the first or second order, has the amplitude
    and the phase of that lag's frequency response."""
    times, clock = np.arange(-0.2, 0.5, 0.01), np.arange(0.05, 0.45, 1e-3)
    motion = smoothed(times, 0.3 * np.sin(OMEGA * times), Window("elbow", 0.0, 0.45, clock, np.zeros(clock.size), 1e3))
    assert motion is not None
    way = (order == ORDERS) & np.isclose(DELAYS, 0.02)
    late = motion.followed(ServoLaw(tuple(np.where(way, 0.0, -math.inf).tolist())))
    delay = 0.02 * (1 - PURE) if order == 4 else 0.02
    second = 1 / (1 + 1j * delay * OMEGA - (delay * OMEGA / (2 * DAMPING)) ** 2)
    behind = np.exp(-1j * (0.02 - delay) * OMEGA)
    responses = [np.exp(-0.02j * OMEGA), 1 / (1 + 0.02j * OMEGA), 1 / (1 + 0.01j * OMEGA) ** 2, second, behind * second]
    wanted = 0.3 * np.imag(responses[order] * np.exp(1j * OMEGA * clock))
    assert late.basis(clock - clock[0]) @ late.coefficients == pytest.approx(wanted, abs=2e-3)
