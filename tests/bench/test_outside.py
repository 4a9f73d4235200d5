"""The joints that the detector is tried on from outside are what they are said to be."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from bench.outside import LENGTH_M, RATE_HZ, STEPS, drawn, moved, tips, without_play

TIME = np.arange(round(3 * RATE_HZ) * STEPS) / RATE_HZ / STEPS
JOINT = replace(drawn(2), friction=0.0, lag=0.0, play=1e-6, mass=1e-4)


def test_without_play_the_joint_follows() -> None:
    """MuJoCo's joint with a play of 1 µrad has the tip acceleration of a bar on a joint that follows, to 5 %."""
    shaft = moved(JOINT, TIME)[1]
    found, wanted = tips(JOINT, shaft), without_play(JOINT, shaft)
    late = slice(1500, None)  # the bar's start has rung down
    assert np.std(found[late] - wanted[late]) < 0.05 * np.std(wanted[late])


def test_play_strikes() -> None:
    """With 20 mrad of play the largest blow rings the bar as some tenths of a rad/s do."""
    joint = replace(JOINT, play=0.02)
    shaft = moved(joint, TIME)[1]
    more = np.abs(tips(joint, shaft) - without_play(joint, shaft)).max()
    assert 0.1 < more / (LENGTH_M * 2 * math.pi * joint.f_res) < 3


@pytest.mark.parametrize("pure", [0.0, 0.5])
def test_a_servo_lags(pure: float) -> None:
    """Of a slow sway the shaft's angle is the goal of 40 ms ago, to 2 % of the sway."""
    joint = replace(drawn(2), lag=0.04, damping=1.0, pure=pure)
    goal, shaft = moved(joint, TIME)
    step = TIME[1] - TIME[0]
    angle = goal[0] + np.cumsum(np.cumsum(shaft)) * step**2
    late = TIME > 1
    assert np.interp(TIME[late] - 0.04, TIME, goal) == pytest.approx(angle[late], abs=0.02 * np.ptp(goal))
