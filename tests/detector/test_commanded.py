"""The commands as one smooth motion: closed forms."""

from __future__ import annotations

import math
from itertools import product

import numpy as np
import pytest
from bench.joints import motion_of

from lostmotion.detector.commanded import NO_CONTACTS, _lobes, alternatives, smoothed
from lostmotion.detector.servo import DAMPING, DELAYS, PURE, SHAPES, ServoLaw
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
    whether the motion reaches 3 or 10 Hz, jerks or stands, and whether it may have corners."""
    step, clock = np.radians(300) / 1023, np.arange(0.0, 0.45, 2.5e-3)
    errors, shares = [], []
    for seed, start in product(range(40, 43), np.arange(1.0, 11.0, 0.7)):
        moved = motion_of(kind, seed)
        times = np.arange(start - 0.2, start + 0.5, 0.01)
        window = Window("elbow", start, 0.45, start + np.arange(450) / 1e3, np.zeros(450), 1e3)
        both = alternatives(times, np.round(moved.position(times) / step) * step, window)
        assert both is not None
        for motion in both:
            basis = motion.basis(clock)
            error = basis @ motion.coefficients - moved.position(start + clock)
            errors.append(error)
            shares.append(error / np.sqrt(np.sum((basis @ motion.covariance) * basis, axis=1)))
    for half in (slice(0, None, 2), slice(1, None, 2)):
        assert 4e-4 < np.sqrt(np.mean(np.square(errors[half]))) < 1.1e-3
        assert 0.6 < np.sqrt(np.mean(np.square(shares[half]))) < 1.15


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


def test_a_corner_of_the_command() -> None:
    """An acceleration that changes from -30 to 30 rad/s² at once, in steps of 0.29°: within 15 ms 0.85 to 1.1 of the
    change are found where there may be corners (0.96), half to three quarters where there are none (0.66); errors are
    0.5 to 1.15 of their standard deviation (0.85), instead of 1.5."""
    step, times, swing = np.radians(300) / 1023, np.arange(-0.2, 0.9, 0.01), 60.0
    rises, shares = [], []
    for corner in 0.4 + np.arange(10) / 1000:
        window = Window("elbow", 0.0, 0.85, np.arange(850) / 1e3, np.zeros(850), 1e3)
        angle = swing / 4 * np.abs(times - corner) * (times - corner)
        both = alternatives(times, np.round((angle + corner) / step) * step - corner, window)
        assert both is not None
        near = corner + np.linspace(-0.015, 0.015, 13)
        accel = [motion.acceleration(near) for motion in both]
        rises.append([(one[-1] - one[0]) / swing for one in accel])
        for motion in both:
            basis = motion.basis(near)
            error = basis @ motion.coefficients - swing / 4 * np.abs(near - corner) * (near - corner)
            shares.append(error / np.sqrt(np.sum((basis @ motion.covariance) * basis, axis=1)))
    smooth, cornered = np.mean(rises, axis=0)
    assert 0.5 < smooth < 0.75
    assert 0.85 < cornered < 1.1
    assert np.sqrt(np.mean(np.square(shares[::2]))) > 1.3
    assert 0.5 < np.sqrt(np.mean(np.square(shares[1::2]))) < 1.15


def test_lobes_of_the_jerk() -> None:
    """Two lobes of the estimated jerk, of areas 6 and -4, are impulses with these root mean squares, each in the three
    bins about the middle of its lobe."""
    jerk, width = np.concatenate([np.full(10, 6.0), np.full(20, -2.0)]), 0.1
    strength = _lobes(jerk, width)
    assert np.flatnonzero(strength).tolist() == [3, 4, 5, 19, 20, 21]
    assert strength[:10].sum() * width == pytest.approx(6.0**2)
    assert strength[10:].sum() * width == pytest.approx(4.0**2)


def test_contacts_of_many_windows_show_that_a_motion_is_smooth() -> None:
    """16 nats of one window do, 3 a window of many do not, and a smooth motion has corners again after 15 windows with
    -3 nats each; a window counts with 30 nats at most."""
    assert NO_CONTACTS.updated(16.0).is_smooth
    assert NO_CONTACTS.updated(1e9) == NO_CONTACTS.updated(30.0)
    doubtful = smooth = NO_CONTACTS
    for _ in range(100):
        doubtful, smooth = doubtful.updated(3.0), smooth.updated(10.0)
    assert not doubtful.is_smooth
    assert smooth.is_smooth
    for _ in range(15):
        smooth = smooth.updated(-3.0)
    assert not smooth.is_smooth


@pytest.mark.parametrize("shape", range(PURE.size))
def test_a_slow_servo(shape: int) -> None:
    """A sine that a servo follows 20 ms late, by a pure delay or a lag of the first or second order, has the amplitude
    and the phase of that lag's frequency response."""
    times, clock = np.arange(-0.2, 0.5, 0.01), np.arange(0.05, 0.45, 1e-3)
    motion = smoothed(times, 0.3 * np.sin(OMEGA * times), Window("elbow", 0.0, 0.45, clock, np.zeros(clock.size), 1e3))
    assert motion is not None
    way = (shape == SHAPES) & np.isclose(DELAYS, 0.02)
    late = motion.followed(ServoLaw(tuple(np.where(way, 0.0, -math.inf).tolist())))
    behind = 0.02 * PURE[shape]
    phase = 1j * (0.02 - behind) * OMEGA
    second = 1 if PURE[shape] == 1 else 1 / (1 + phase + (phase / (2 * DAMPING[shape])) ** 2)
    wanted = 0.3 * np.imag(np.exp(-1j * behind * OMEGA) * second * np.exp(1j * OMEGA * clock))
    assert late.basis(clock - clock[0]) @ late.coefficients == pytest.approx(wanted, abs=2e-3)
