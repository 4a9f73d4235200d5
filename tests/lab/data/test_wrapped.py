"""Angles that begin anew are taken to turn on, and jumps that are none stay."""

from __future__ import annotations

import logging

import numpy as np
import pytest

from lostmotion.drivers.recording import Recording
from lostmotion.lab.data.experiment import experiments
from lostmotion.lab.data.readings import unwrapped
from lostmotion.model import build_model

T = np.arange(2000) / 200
TO_AND_FRO = 9 * np.sin(0.7 * T) + 1.5 * np.sin(5 * T)
"""an angle [rad] of three turns, with reversals"""
RUNNING = 40 * T + 10 * np.sin(T)
SMALL = 0.4 * np.sin(2 * T)


@pytest.mark.parametrize(
    ("angle", "period"),
    [(TO_AND_FRO, 2 * np.pi), (RUNNING, 2 * np.pi), (RUNNING, 65536 * np.pi / 1000), (SMALL, 2 * np.pi)],
)
@pytest.mark.parametrize("noise", [0.0, 2e-3])
def test_an_angle_that_begins_anew_turns_on(angle: np.ndarray, period: float, noise: float) -> None:
    """A turn, or the range of a counter of 16 bits, is put back at each jump, also near rest and with noise."""
    true = angle + noise * np.random.default_rng(1).standard_normal(T.size)
    found = unwrapped(np.mod(true, period))
    assert found is not None
    assert found - found[0] == pytest.approx(true - true[0], abs=1e-9 if period < 7 else 0.02 * period)


@pytest.mark.parametrize("late", [0.0, 0.3])
def test_a_jump_between_two_goals_is_none(late: float) -> None:
    """A servo that is read ten times a second is there at once, or half way: the jump is a motion."""
    goal = 1.2 * np.sign(np.sin(0.9 * np.arange(300) / 10))
    read = goal - late * np.diff(goal, prepend=goal[0])
    assert unwrapped(read + 1e-4 * np.random.default_rng(2).standard_normal(300)) is None
    assert unwrapped(goal) is None


def test_an_angle_that_never_jumps_stays() -> None:
    """Nor is one of three turns in small steps, a constant, or a few samples."""
    assert unwrapped(TO_AND_FRO) is None
    assert unwrapped(np.ones(50)) is None
    assert unwrapped(np.array([0.0, 6.2, 0.1])) is None


def test_it_is_told(caplog: pytest.LogCaptureFixture) -> None:
    """A joint's recording is used without the jumps, and a warning says how often and after how much."""
    recording = Recording(T, {"position": np.mod(TO_AND_FRO, 2 * np.pi), "torque": np.sin(T)}, {}, name="arm.csv")
    with caplog.at_level(logging.WARNING):
        (found,) = experiments(build_model("joint"), [recording])
    assert found.measured["position"] == pytest.approx(TO_AND_FRO, abs=1e-9)
    assert "position begins anew 6 times, after 6.283 rad each" in caplog.text
