"""The simulated joints of ``bench.outside`` have their documented properties."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from bench.outside import LENGTH_M, RATE_HZ, STEPS, drawn, moved, scored, tips, without_play

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


@pytest.mark.slow
def test_the_size_of_the_play_is_told_and_held(tmp_path: Path) -> None:
    """Of four joints drawn at random, with 1 mrad and more, two thirds of the windows above 30 dB give the size of the
    play, and 95 to 99.7 % of the intervals hold it: fewer would, were they 0.6 times as wide (91.3 %); of
    the severities 90 % do."""
    joints = (drawn(seed) for seed in range(5200, 5220))
    recordings = [scored(joint, tmp_path) for joint in [joint for joint in joints if joint.play > 1e-3][4:8]]
    told, reach, severe = [], [], []
    for one in recordings:
        told += [score["play"] is not None for score, db in zip(one.scores, one.snr_db, strict=True) if db > 30]
        sizes = np.array([[s["play"], s["play_low"], s["play_high"]] for s in one.scores if s["play"] is not None])
        end = np.where(sizes[:, 0] > one.joint.play, sizes[:, 1], sizes[:, 2])
        reach += ((sizes[:, 0] - one.joint.play) / (sizes[:, 0] - end)).tolist()
        severe += [score["severity_low"] <= one.joint.play <= score["severity_high"] for score in one.scores]
    assert np.mean(told) > 0.67
    assert 0.95 <= np.mean(np.array(reach) < 1) <= 0.997
    assert np.mean(np.array(reach) < 0.6) < 0.95
    assert np.mean(severe) >= 0.9


@pytest.mark.slow
def test_a_healthy_joint_tells_no_play(tmp_path: Path) -> None:
    """Of three joints without play whose trapezoids ring the bar in half of the windows at most one window gives a size
    (seeds 9000 to 9119 were developed with); 32 did where the commanded motion was known too well at its corners."""
    joints = [replace(drawn(seed), play=0.0) for seed in (9044, 9072, 9116)]
    scores = [score for joint in joints for score in scored(joint, tmp_path).scores]
    assert np.mean([score["impact"] for score in scores]) > 0.5
    assert sum(score["play"] is not None for score in scores) <= 1
