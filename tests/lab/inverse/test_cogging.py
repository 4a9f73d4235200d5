"""A bare motor that cogs, under the control of its speed: simulated by LSODA with its own equations."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from lostmotion.drivers.recording import Recording
from lostmotion.model.effects.guesses import MotionScales, turns
from tests.lab.inverse.test_inverse import explained

INERTIA, VISCOUS, COGGING, COGS = 2e-4, 1e-3, 0.18, 84
"""[kg m²], [N m s/rad], [N m], times a turn: twelve slots and fourteen poles."""
MODEL = f'base = "joint"\n[parameters]\nJ = {{ value = {INERTIA}, fixed = true }}\n'
"""A steady speed does not tell the inertia, which is known."""


def cogging(cogs: int = COGS, seconds: float = 4.0) -> Recording:
    """A speed of 6 rad/s, held by a proportional and integral controller, a thousand samples a second."""

    def torque(t: float, x: np.ndarray) -> float:
        return float(0.2 * (6.0 - x[1]) + 2.0 * (6.0 * t - x[0]))

    def moves(t: float, x: np.ndarray) -> list[float]:
        cogged = COGGING * math.sin(cogs * x[0] + 0.7)
        return [x[1], (torque(t, x) - VISCOUS * x[1] - cogged) / INERTIA]

    time = np.arange(0.0, seconds, 1e-3)
    x = solve_ivp(moves, (0.0, seconds), [0.0, 6.0], "LSODA", time, rtol=1e-8, atol=1e-10).y
    rng = np.random.default_rng(4)
    driven = np.array([torque(*each) for each in zip(time.tolist(), x.T, strict=True)])
    columns = {
        "position": x[0] + 2e-5 * rng.standard_normal(time.size),
        "torque": driven + 2e-3 * rng.standard_normal(time.size),
    }
    return Recording(time, columns, {}, {}, 0, "cogging.csv")


@pytest.mark.slow
def test_a_motor_cogs_as_often_as_its_slots_and_poles_say(tmp_path: Path) -> None:
    """84 periods a turn are named with their number and size; a catalogue that ended at 60 had one of 14 or none."""
    answer = explained(tmp_path, MODEL, [cogging()])
    assert answer["missing"][0] == "torque_ripple"
    assert "84 times a turn" in " ".join(answer["words"])
    assert abs(answer["parameters"]["torque_ripple.tau_r"][0]) == pytest.approx(COGGING, rel=0.05)


@pytest.mark.slow
@pytest.mark.parametrize("cogs", [10, 3])
def test_a_servo_cogs_over_few_periods(cogs: int, tmp_path: Path) -> None:
    """Ten or three periods a turn over a range of 1.5 rad, most of the time over half of it, are named with their
    number."""

    def moved(phase: float) -> Recording:
        def goal(t: float) -> float:
            tones = (0.21, 1.0), (0.55, 2.1), (1.3, 0.3)
            return 0.36 * sum(math.sin(2 * math.pi * f * t + phase * p) for f, p in tones) / math.sqrt(1.5)

        def moves(t: float, x: np.ndarray) -> list[float]:
            duty = min(max(5.28 * (goal(t) - x[0]), -1.0), 1.0)
            torque = 1.2 * (12.0 * duty - 1.2 * x[1]) / 4.4 - 0.08 * x[1] + 0.4 * math.sin(cogs * x[0] + 0.3)
            return [x[1], torque / 6e-3]

        time = np.arange(0.0, 8.0, 0.02)
        x = solve_ivp(moves, (0.0, 8.0), [goal(0.0), 0.0], "LSODA", time, rtol=1e-8, atol=1e-10).y
        noise = 4e-4 * np.random.default_rng(int(10 * phase)).standard_normal(time.size)
        columns = {"command": np.array([goal(t) for t in time.tolist()]), "position": x[0] + noise}
        return Recording(time, columns, {}, {}, 0, f"{phase}.csv")

    model = 'base = "servo"\neffects = ["viscous_friction"]\n'
    answer = explained(tmp_path, model, [moved(phase) for phase in (0.4, 2.9)])
    assert answer["missing"] == ["torque_ripple"]
    assert f"{cogs} times a turn" in " ".join(answer["words"])


def turned(seed: int, periods: int, size: float) -> Recording:
    """A joint that moves over 0.3 turns, in closed form, with a torque that repeats so many times a turn."""
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, 10.0, 5e-3)
    tones = [(0.45, 0.31, rng.uniform(0, 6)), (0.3, 0.83, rng.uniform(0, 6)), (0.2, 1.4, rng.uniform(0, 6))]
    waves = [(a, 2 * math.pi * f, 2 * math.pi * f * time + phase) for a, f, phase in tones]
    angle = sum(a * np.sin(at) for a, _, at in waves)
    speed = sum(a * w * np.cos(at) for a, w, at in waves)
    torque = sum(-a * w**2 * np.sin(at) for a, w, at in waves) * 0.05 + 0.02 * speed
    torque = torque + size * np.sin(periods * angle + 0.7) + 3e-3 * rng.standard_normal(time.size)
    columns = {"position": angle + 2e-5 * rng.standard_normal(time.size), "torque": torque}
    return Recording(time, columns, {}, {}, 0, f"turned{seed}.csv")


@pytest.mark.slow
@pytest.mark.parametrize(("periods", "named"), [(4, "torque_ripple"), (2, "torque_ripple"), (1, "gravity_torque")])
def test_a_joint_turns_over_little_more_or_less_than_a_period(periods: int, named: str, tmp_path: Path) -> None:
    """What leaves no more than noise is named, not a weight and a spring that together leave ten times as much; nor is
    a wave named for a weight."""
    model = 'base = "joint"\neffects = ["viscous_friction"]\n'
    answer = explained(tmp_path, model, [turned(seed, periods, 0.3) for seed in (1, 2, 3)])
    assert answer["missing"] == [named]
    assert answer["complete"]


def test_no_number_of_periods_is_left_out_of_a_motion_of_a_few_degrees() -> None:
    """Beside a play, where fits begin again at other numbers, they may differ by more."""
    still = MotionScales(0.1, 1.0, 1.7, *(0.0,) * 7, inertia=0.04, length=8.0)
    assert turns(still, 60) == list(range(1, 61))
    assert len(turns(replace(still, d=1e-4), 60)) < 60
