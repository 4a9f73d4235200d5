"""The commands as one smooth motion: closed forms."""

from __future__ import annotations

import math
from itertools import product

import numpy as np
import pytest
from bench.joints import motion_of

from lostmotion.detector.commanded import Commanded, smoothed
from lostmotion.detector.servo import DAMPING, DELAYS, ORDERS, PURE, ServoLaw
from lostmotion.detector.window import Window

OMEGA = 2 * np.pi * 1.5


@pytest.mark.parametrize("seconds", [0.2, 0.45, 2.5])
def test_a_sines_acceleration(seconds: float) -> None:
    """-w² times the angle, to a thousandth of its amplitude, however long the segment is."""
    times, clock = np.arange(-0.2, seconds + 0.05, 0.01), np.arange(0.0, seconds, 1e-3)
    motion = smoothed(
        times, 0.3 * np.sin(OMEGA * times), Window("elbow", 0.0, seconds, clock, np.zeros(clock.size), 1e3)
    )
    assert motion is not None
    expected = -0.3 * OMEGA**2 * np.sin(OMEGA * clock)
    assert motion.acceleration(clock) == pytest.approx(expected, abs=0.3e-3 * OMEGA**2)
    assert motion.basis(clock) @ motion.coefficients == pytest.approx(0.3 * np.sin(OMEGA * clock), abs=6e-6)


def test_commands_in_bunches() -> None:
    """Twenty at a time, nothing between: the motion is followed where there are commands."""
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


@pytest.mark.parametrize("phase", np.arange(8) / 8)
def test_a_slow_sway_is_smoother_than_white_jerk(phase: float) -> None:
    """Of commands of 1 Hz in steps of 0.29° the fifth derivative is white rather than the jerk, wherever the segment
    begins; in two of the eight only, when the likelihood lost its smoothest modes to rounding."""
    step, times = np.radians(300) / 1023, np.arange(-0.2, 0.9, 0.01)
    window = Window("elbow", 0.0, 0.85, np.arange(850) / 1e3, np.zeros(850), 1e3)
    angle = 0.3 * np.sin(2 * math.pi * (times + phase))
    motion = smoothed(times, np.round(angle / step) * step, window)
    assert motion is not None
    assert motion.order == 5


def test_what_is_too_fast_for_the_polynomial() -> None:
    """White jerk of strength q has the variance q / (5 pi w^5) beyond w, whose covariance is the integral of its
    spectrum q / w^6."""
    motion = Commanded(0.5, 0.5, np.zeros(51), np.zeros((51, 51)), 3, 2e4)
    rest, omega = motion.rest(30, 2e-3), np.linspace(100.0, 1e4, 200_000)
    assert motion.fastest == pytest.approx(100.0)
    assert rest[0, 0] == pytest.approx(2e4 / (5 * math.pi * 100.0**5), rel=0.01)
    for apart in (5, 29):
        found = np.trapezoid(np.cos(omega * apart * 2e-3) / omega**6, omega) * 2e4 / math.pi
        assert rest[0, apart] == pytest.approx(found, abs=0.02 * rest[0, 0])


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
