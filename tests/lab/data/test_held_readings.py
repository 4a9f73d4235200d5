"""Readings that a log repeats until the next one comes: a slower bus on a faster clock."""

from __future__ import annotations

import logging
import math

import numpy as np
import pytest

from lostmotion.drivers.recording import Recording
from lostmotion.lab.data.experiment import experiments
from lostmotion.lab.data.readings import held_for
from lostmotion.lab.inverse.explain import fitted
from lostmotion.lab.inverse.likelihood import Method
from lostmotion.model import Sampled, build_model
from lostmotion.model.motion import FloatArray

INERTIA, VISCOUS = 0.09, 1.0
ROWS = 10
HELD = np.repeat(np.sin(np.arange(60.0)), 3)


def arm(seed: int, is_held: bool = True) -> Recording:
    """A joint led along three slow sines for 20 s, in closed form, read 100 times a second; if held, logged at 1 kHz,
    each reading until the next one, which comes a row early or late."""
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, 20.0, 0.01)
    angle, speed, acceleration = (np.zeros(time.size) for _ in range(3))
    for size, hz in ((0.4, 0.11), (0.3, 0.23), (0.1, 0.7)):
        rate, phase = 2 * math.pi * hz, rng.uniform(0, 2 * math.pi)
        angle += size * np.sin(rate * time + phase)
        speed += size * rate * np.cos(rate * time + phase)
        acceleration -= size * rate**2 * np.sin(rate * time + phase)
    position = angle + 2e-5 * rng.standard_normal(time.size)
    torque = INERTIA * acceleration + VISCOUS * speed + 0.3 * rng.standard_normal(time.size)
    if not is_held:
        return Recording(time, {"position": position, "torque": torque}, name=f"arm{seed}.csv")
    came = ROWS * np.arange(time.size) + rng.integers(-1, 2, time.size) * (np.arange(time.size) > 0)
    rows = np.searchsorted(came, np.arange(ROWS * time.size), side="right") - 1
    columns = {"position": position[rows], "torque": torque[rows]}
    return Recording(np.arange(rows.size) * 1e-3, columns, name=f"held{seed}.csv")


@pytest.mark.parametrize("is_held", [False, True])
def test_held_readings_do_not_hide_friction(is_held: bool) -> None:
    """Viscous friction is right within 5 %; of a staircase of angles it was 0.30 N m s/rad instead of 1."""
    model = build_model("joint", ["viscous_friction"])
    recorded = experiments(model, [arm(seed, is_held) for seed in (1, 2)])
    found = fitted(model, recorded, Method.TORQUE, {"torque": 0.3, "position": 2e-5})
    values = {one.name: one.value for one in found.estimates}
    assert values["viscous_friction.b_v"] == pytest.approx(VISCOUS, rel=0.05)


def test_held_readings_are_told(caplog: pytest.LogCaptureFixture) -> None:
    """One line says how many rows a reading is held; 2000 of 20 000 rows are left, of angle and torque."""
    with caplog.at_level(logging.WARNING, "lostmotion"):
        held = experiments(build_model("joint"), [arm(1)])[0]
    assert "readings of position are repeated until the next one comes, 10 rows as a rule" in caplog.text
    assert isinstance(held.drive, Sampled)
    assert 1995 < held.time.size <= 2000
    assert 1995 < held.drive.time.size <= 2000


def test_a_command_that_is_held_alone_is_left_as_it_is() -> None:
    """A goal of 10 Hz beside an angle of 100 Hz keeps its steps."""
    one = arm(3, is_held=False)
    goal = np.repeat(one.columns["position"][::10], 10)
    held = experiments(
        build_model("servo"), [Recording(one.time, {"position": one.columns["position"], "command": goal})]
    )
    assert isinstance(held[0].drive, Sampled)
    assert held[0].drive.time.size == held[0].time.size == one.time.size


@pytest.mark.parametrize(
    ("values", "rows"),
    [
        (HELD, 3),
        (np.concatenate([HELD, np.zeros(90), HELD]), 3),
        (np.repeat(np.concatenate([[0.0, 0.1, 0.5], np.arange(1.0, 60.0)]), 4), 4),
        (np.sin(np.arange(200.0)), 1),
        (np.floor(np.arange(400) / 7.0), 1),
        (np.round(20 * np.sin(np.arange(900) / 300)), 1),
        (np.round(3 * np.random.default_rng(1).standard_normal(900)), 1),
    ],
    ids=["held", "with a rest", "at one speed", "fine", "even steps of an encoder", "a slow sine in steps", "coarse"],
)  # fmt: skip
def test_steps_of_an_encoder_are_no_held_readings(values: FloatArray, rows: int) -> None:
    """What repeats because it hardly moves changes by one step at a time, or at uneven intervals."""
    assert held_for(values) == rows
