"""What a sensor reads beside motion, learnt from windows."""

from __future__ import annotations

import math

import numpy as np
import pytest

from lostmotion.detector.offset import LARGEST, OFFSET_UNKNOWN, OffsetLaw, averaged


def learnt(seed: int, scatter: float, windows: int = 40) -> OffsetLaw:
    """The law after windows at angles of ± 0.6 rad, of an offset of 0.4 m/s² and gravity of 9.8 m/s² 1 rad away."""
    rng = np.random.default_rng(seed)
    law = OFFSET_UNKNOWN
    for angle in rng.uniform(-0.6, 0.6, windows):
        law = law.updated(angle, 0.4 + 9.8 * math.sin(angle + 1) + rng.normal(0, scatter))
    return law


def test_gravity_is_learnt() -> None:
    """A scatter of 0.05 m/s²: after 40 windows it is known to 0.07 m/s² and 0.3 m/s² per rad, and this is true."""
    angles = np.linspace(0.1, 0.3, 9)
    read, level, slope = learnt(1, 0.05).read(angles)
    wanted = 0.4 + 9.8 * np.sin(angles + 1)
    assert level < 0.07
    assert slope < 0.3
    assert abs(np.mean(read - wanted)) < level
    assert np.polyfit(angles, read - wanted, 1)[0] == pytest.approx(0, abs=2 * slope)


def test_before_the_first_window_anything_may_be_read() -> None:
    """Offset and gravity are uncertain by what gravity can be."""
    read, level, slope = OFFSET_UNKNOWN.read(np.zeros(3))
    assert read.tolist() == [0, 0, 0]
    assert level > LARGEST
    assert slope == pytest.approx(LARGEST, rel=0.01)


def test_other_joints_that_turn_the_sensor_are_seen() -> None:
    """Readings that scatter by 2 m/s² have that uncertainty, and those of a turned sensor at once."""
    law = learnt(2, 2.0)
    assert 1.5 < law.read(np.zeros(3))[1] < 3
    assert law.read(np.zeros(3))[2] > 1.5
    turned = learnt(3, 0.05).updated(0.0, -5.0)
    assert turned.read(np.zeros(3))[1] > 1
    for _ in range(150):
        turned = turned.updated(0.0, -5.0)
    assert turned.read(np.zeros(3))[0].mean() == pytest.approx(-5.0, abs=0.2)


def test_a_bounded_relative_motion_hardly_moves_the_average() -> None:
    """A joint that swings 5 mrad to either side of its gear at 5.5 Hz, 0.1 m away: wherever the 0.45 s begin, Hann's
    average is at most 0.02 m/s² from zero, the plain mean up to 0.05."""
    time, omega = np.arange(450) / 1000, 2 * math.pi * 5.5
    swings = [-0.1 * 5e-3 * omega**2 * np.sin(omega * time + phase) for phase in np.linspace(0, 2 * math.pi, 40)]
    assert max(abs(averaged(swing)) for swing in swings) < 0.02
    assert max(abs(swing.mean()) for swing in swings) > 0.05
    assert averaged(np.ones(7)) == pytest.approx(1.0)
