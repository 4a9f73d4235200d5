"""The third simulator of the bench, and what the bench makes of windows."""

from __future__ import annotations

import math

import numpy as np
import pytest
from bench.hardstops import MOTIONS, Sines, Trapezoids, hard_stops
from bench.roc.waveforms import LENGTH_M, Bar, tip_without_play
from bench.severity import medians

from lostmotion.model import Step

TIMES = np.arange(3000) / 1000


def test_without_play_the_joint_follows() -> None:
    """A play of 1 µrad: the tip's acceleration is that of a joint which follows its command exactly, to 3 %."""
    motion = Sines(3, 2.4)
    found = hard_stops(motion, TIMES, 1e-6, Bar(), mass_kg=0.0, friction=0.0)
    wanted = tip_without_play(motion, TIMES, Bar())
    late = TIMES > 1.5  # the bar's start has rung down
    assert np.std(found[late] - wanted[late]) < 0.03 * np.std(wanted[late])


@pytest.mark.parametrize("restitution", [0.0, 0.3])
def test_first_impact_by_hand(restitution: float) -> None:
    """A shaft that starts with constant acceleration a through half a play phi strikes with v = sqrt(a phi) and rings
    the bar with l omega (1 + e) v; before that the tip does not move."""
    phi, start = 0.02, 0.1
    motion = Step(0.5, 1.0, start)
    found = hard_stops(motion, TIMES, phi, Bar(zeta=1e-6), restitution, mass_kg=0.0, friction=0.0)
    meets = np.argmax(motion.position(TIMES) >= phi / 2)
    assert np.abs(found[: meets - 2]).max() < 1e-9
    speed = float(motion.velocity(TIMES[meets : meets + 1])[0])
    first = np.abs(found[meets : meets + 8]).max()
    assert first == pytest.approx(LENGTH_M * 2 * math.pi * 58 * (1 + restitution) * speed, rel=0.05)


def test_motions_are_their_own_derivatives() -> None:
    """Speed and acceleration of each motion are the differences of its angle; trapezoids keep their limits."""
    fine = 2.0 + np.arange(2000) * 2e-4
    for make in MOTIONS.values():
        motion = make(5)
        speed, accel = np.gradient(motion.position(fine), 2e-4), np.gradient(motion.velocity(fine), 2e-4)
        assert np.abs(speed - motion.velocity(fine))[2:-2].max() < 0.02
        assert np.abs(accel - motion.acceleration(fine))[2:-2].max() < 0.05 * max(np.abs(accel).max(), 1.0)
    found = Trapezoids(5)
    assert np.abs(found.velocity(TIMES)).max() <= 2.05
    assert 15 <= np.abs(found.acceleration(TIMES)).max() <= 40


def test_medians_of_ten() -> None:
    """Forty values in turn give four medians of ten each; fewer than ten give none."""
    assert medians(np.arange(40.0)) == [18.0, 19.0, 20.0, 21.0]
    assert medians(np.arange(9.0)) == []
