"""Recordings that begin with a step of the input."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from lostmotion.daemon.cli import cli
from lostmotion.drivers.recording import Recording, write_recording
from lostmotion.lab.data.checks import check_goal
from lostmotion.lab.data.step_start import with_rest_before
from lostmotion.lab.errors import ExperimentError
from lostmotion.model.motion import FloatArray

TIME_CONSTANT_S, DAMPING, COULOMB, DEGREE = 0.1, 8.2, 9.2, np.pi / 180
TIME = np.arange(0.0, 1.0, 0.006)


def started(duty: float) -> FloatArray:
    """The angle of a motor from rest, in closed form, in whole degrees as its encoder has them."""
    speed = np.sign(duty) * (abs(duty) - COULOMB) / DAMPING
    turned = speed * (TIME - TIME_CONSTANT_S * (1 - np.exp(-TIME / TIME_CONSTANT_S)))
    return np.asarray(DEGREE * np.round(turned / DEGREE))


def recorded(position: FloatArray, torque: FloatArray) -> Recording:
    """A recording of these columns."""
    return Recording(TIME, {"position": position, "torque": torque}, name="run.csv")


CONSTANT = np.full(TIME.size, 60.0)
CHANGES = 60.0 + 5.0 * np.sin(20 * TIME)


@pytest.mark.parametrize(
    ("position", "torque", "is_step"),
    [
        (started(60.0), CONSTANT, True),
        (started(60.0) + 70.0, CONSTANT, True),
        (started(60.0), np.where(TIME < 0.3, 60.0, -60.0), True),
        (6.0 * TIME, CONSTANT, False),
        (6.0 * TIME, np.zeros(TIME.size), False),
        (started(60.0), CHANGES, False),
        (np.zeros(TIME.size), CONSTANT, False),
        (np.cos(4 * TIME), 10 * np.cos(4 * TIME), False),
    ],
)
def test_the_input_was_switched_on_where_a_motion_begins_at_rest(
    position: FloatArray, torque: FloatArray, is_step: bool
) -> None:
    """At a constant input from the first row on, and nowhere else; the rows that were there are as they were."""
    held = recorded(position, torque)
    found = with_rest_before(held, "torque")
    count = found.time.size - TIME.size
    assert (count > 0) is is_step
    assert np.array_equal(found.columns["position"][count:], position)
    assert np.array_equal(found.columns["torque"][count:], torque)
    assert np.all(found.columns["torque"][:count] == 0)
    assert np.all(found.columns["position"][:count] == position[0])
    assert np.allclose(np.diff(found.time), 0.006)


@pytest.mark.parametrize(("spacing", "count"), [([0.0, 0.0, 0.3], 0), ([1e-6, 1e-6, 1.0], TIME.size)])
def test_rows_in_bursts(spacing: list[float], count: int) -> None:
    """Times that repeat tell no start; a rest has no more rows than the recording."""
    time = np.cumsum(np.resize(spacing, TIME.size))
    found = with_rest_before(replace(recorded(started(60.0), CONSTANT), time=time), "torque")
    assert found.time.size - TIME.size == count


def test_the_inertia_of_a_motor_that_is_switched_on_at_the_first_row(tmp_path: Path) -> None:
    """Its time constant is a tenth of a second, and the first seventh of a recording is where the filter has its
    transient: without the rest the inertia was 1.35 times the true one."""
    names = []
    for duty in (100.0, 80.0, 60.0, 40.0, -20.0, -40.0, -60.0, -80.0):
        names.append(str(tmp_path / f"{duty:g}.csv"))
        write_recording(recorded(started(duty), np.full(TIME.size, duty)), Path(names[-1]))
    (tmp_path / "m.toml").write_text('base = "joint"\neffects = ["viscous_friction", "coulomb_friction"]\n')
    model, fitted = str(tmp_path / "m.toml"), str(tmp_path / "fitted.toml")
    ran = CliRunner().invoke(cli, ["lab", "fit", model, *names, "-o", fitted, "--json"])
    assert ran.exit_code == 0, ran.output
    found = {name: value for name, (value, _, _) in json.loads(ran.stdout)["parameters"].items()}
    assert found["J"] == pytest.approx(TIME_CONSTANT_S * DAMPING, rel=0.15)
    assert found["viscous_friction.b_v"] == pytest.approx(DAMPING, rel=0.05)
    assert found["coulomb_friction.tau_c"] == pytest.approx(COULOMB, rel=0.2)


@pytest.mark.parametrize(
    ("first", "ends", "is_asked"), [(0.0, 0.57, True), (1.2, 0.62, True), (0.0, 0.2, False), (0.6, 0.605, False)]
)
def test_a_servo_comes_to_a_goal_that_was_set_at_the_first_row(first: float, ends: float, is_asked: bool) -> None:
    """A goal that never changes is one step where the servo begins elsewhere, at rest, and comes to it; else what moves
    the servo was not recorded."""
    decay = np.exp(-TIME / 0.1) * (1 + TIME / 0.1)
    position = 5e-4 * np.round((ends + (first - ends) * decay) / 5e-4)
    found = with_rest_before(
        Recording(TIME, {"position": position, "command": np.full(TIME.size, 0.6)}, name="step.csv"), "command"
    )
    assert (found.time.size > TIME.size) is is_asked
    assert found.time.size - TIME.size == int(is_asked)  # more readings would count as measured
    if is_asked:
        check_goal(found)
        assert {*found.columns["command"].tolist()} == {0.6, first}
    else:
        with pytest.raises(ExperimentError, match=r"found the command 0\.6 at all times"):
            check_goal(found)


def test_the_limit_of_the_speed_of_a_servo_that_comes_to_constant_goals(tmp_path: Path) -> None:
    """Its speed is at most 1.5 rad/s; it is integrated here, in steps of 0.2 ms.  Where the goal counted as always
    there, it was no limit, and a lag and friction were named."""
    rng, names = np.random.default_rng(3), []
    for goal in (0.6, -0.55, 0.4, 0.8):
        aim = place = speed = 0.0
        rows = ["time,command,position"]
        for k in range(5000):
            if k % 100 == 0:
                rows.append(f"{2e-4 * k:.4f},{goal},{place + 5e-4 * rng.standard_normal():.5f}")
            aim += float(np.clip(goal - aim, -3e-4, 3e-4))
            speed += 2e-4 * (900 * (aim - place) - 48 * speed)
            place += 2e-4 * speed
        names.append(str(tmp_path / f"goal{goal}.csv"))
        Path(names[-1]).write_text("\n".join(rows) + "\n")
    (tmp_path / "m.toml").write_text('base = "servo"\neffects = ["velocity_limit"]\n')
    model, fitted = str(tmp_path / "m.toml"), str(tmp_path / "fitted.toml")
    ran = CliRunner().invoke(cli, ["lab", "fit", model, *names, "-o", fitted, "--json"])
    assert ran.exit_code == 0, ran.output
    found = json.loads(ran.stdout)["parameters"]
    assert found["velocity_limit.omega_max"][0] == pytest.approx(1.5, rel=0.03)
