"""Files that a program reads wrongly with ease: what ``lostmotion`` asks about instead, and what it takes."""

from __future__ import annotations

import logging
from pathlib import Path

import numpy as np
import pytest

from lostmotion.lab.commands.reading import Files, used
from tests.daemon.cli_world import call

T = np.arange(1500) / 100
SWING = 40 * np.exp(-T / 20) * np.cos(5 * T)
"""of a pendulum [deg]"""


def noise(deviation: float, seed: int, size: int = T.size) -> np.ndarray:
    """White noise."""
    return np.random.default_rng(seed).normal(0, deviation, size)


def table(path: Path, *columns: np.ndarray, head: str = "", sign: str = ",") -> Path:
    """A table, without a header where none is given."""
    np.savetxt(path, np.column_stack(columns), "%.6f", sign, header=head, comments="")
    return path


def told(path: Path, *options: str) -> str:
    """All that is printed of a file."""
    result = call("import", path, *options)
    assert result.exit_code in (0, 2), result.output
    return result.output


def explained(base: str, path: Path, *options: str) -> str:
    """By which line a question about a file is refused."""
    result = call("lab", "explain", base, path, *options)
    assert result.exit_code == 2, result.output
    return result.output


def test_a_servo_whose_goal_never_changes_is_refused(tmp_path: Path) -> None:
    """It holds, and is pulled by hand."""
    path = table(tmp_path / "servo.csv", T, 0 * T + 0.2, 0.2 + SWING / 2000, head="time,goal,position")
    assert "found the command 0.2 at all times, expected a goal that changes" in explained("servo", path)


def test_an_input_at_which_the_angle_settles_is_a_goal(tmp_path: Path) -> None:
    """A step of 100 counts, and the angle ends at 100; a motor that turns on under a step of a voltage does not."""
    step, since = 100.0 * (T >= 1), np.maximum(T - 1, 0)
    settled = np.rint(100 * (1 - np.exp(-3 * since) * (np.cos(9 * since) + np.sin(9 * since) / 3)))
    path = table(tmp_path / "step.csv", T, step, step - settled, settled, head="t,u,v,theta")
    assert "theta follows u as a goal, with a gain of 1.00: it is hardly one" in told(path)
    table(path, T, step, step - settled, 20 * since, head="t,u,v,theta")
    assert "as a goal" not in told(path)


def test_readings_that_are_cut_off_are_told(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """Of an accelerometer whose range ends at 30 m/s², for an oscillator; not of one that has a wider range."""
    caplog.set_level(logging.WARNING)
    for reach, is_cut in ((30.0, True), (60.0, False)):
        caplog.clear()
        felt = np.clip(SWING + noise(0.05, 10), -reach, reach)
        path = table(tmp_path / "beam.csv", T, felt, head="time,accel (m/s^2)")
        with used("oscillator", Files((path,))):
            pass
        said = [one for one in caplog.messages if "the range of the sensor cut the motion off" in one]
        assert len(said) == is_cut
        assert not is_cut or "readings of accel stand at -30 and 30 m/s^2" in said[0]
