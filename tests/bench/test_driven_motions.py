"""The driven systems of the bench obey their equations, and answers are graded as stated."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from bench.driven_motions import Case
from bench.driven_systems import Bar, Joint, Servo, lagged


def test_a_bar_balances_its_forces() -> None:
    """Mass times acceleration is the force less damper and spring; readings of the place, differentiated twice, are the
    acceleration that an accelerometer reads."""
    bar = replace(Bar.drawn(np.random.default_rng(3), ()), noise=0.0, column="displacement")
    place = bar.record(np.random.default_rng(1), "0.csv")
    accel = replace(bar, column="accel").record(np.random.default_rng(1), "0.csv")
    q, a, step = place.columns["displacement"], accel.columns["accel"], place.time[1]
    middle = slice(20, -20)
    speed = np.gradient(q, step)[middle]
    left = bar.mass * a[middle] + bar.damping * speed + bar.spring * q[middle] - place.columns["force"][middle]
    assert np.std(left) < 0.02 * np.std(place.columns["force"])


def test_torques_of_a_joint_are_those_of_its_motion() -> None:
    """The recorded torque is the inertia's and the hidden friction's."""
    joint = replace(Joint.drawn(np.random.default_rng(5), ("viscous_friction",)), noise=0.0, torque_noise=0.0, rate=500)
    found = joint.record(np.random.default_rng(1), "0.csv")
    step = found.time[1]
    speed = np.gradient(found.columns["position"], step)
    friction = joint.law.scale * joint.law.sizes[0] * speed / joint.law.speed
    needed = joint.inertia * np.gradient(speed, step) + friction
    assert np.std((found.columns["torque"] - needed)[5:-5]) < 0.01 * np.std(needed)


def test_a_delay_makes_a_servo_late() -> None:
    """Behind a delay the same servo moves as without it, so much later."""
    servo = replace(Servo.drawn(np.random.default_rng(2), ()), noise=0.0, rate=200.0)
    at_once = servo.record(np.random.default_rng(1), "0.csv").columns["position"]
    late = replace(servo, delay=0.05).record(np.random.default_rng(1), "0.csv").columns["position"]
    assert late[210:] == pytest.approx(at_once[200:-10], abs=2e-3)


def test_a_lagged_ramp_is_late_by_the_lag() -> None:
    """A first-order low-pass makes a ramp later by its time constant, exactly."""
    time = np.arange(0.0, 1.0, 0.01)
    assert lagged(time, 3 * time, 0.05)[-1] == pytest.approx(3 * (time[-1] - 0.05), abs=1e-6)
    assert lagged(time, np.ones_like(time), 0.05) == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("hidden", "named", "confusable", "is_complete", "grade"),
    [
        ("none", (), (), True, "right"), ("none", (), (), False, "more"), ("none", ("sensor_lag",), (), True, "more"),
        ("second_mode", ("second_mode",), (), False, "right"), ("second_mode", (), (), True, "nothing"),
        ("command_delay", ("actuator_lag",), (("actuator_lag", "command_delay"),), True, "alike"),
        ("gravity_torque+coulomb_friction", ("gravity_torque",), (), False, "part"),
        ("bias_drift", ("bias_drift", "sensor_lag"), (), True, "more"),
    ],
)  # fmt: skip
def test_grades(hidden: str, named: Any, confusable: Any, is_complete: bool, grade: str) -> None:
    """What is named is compared with what is hidden; nothing is only right where nothing is said to be left."""
    found: Any = SimpleNamespace(missing=named, confusable=confusable, complete=is_complete)
    assert Case("oscillator", hidden, 0).outcome(found) == grade


def test_resonances_cover_decades() -> None:
    """Bars of 1 to 60 Hz are drawn."""
    drawn = [Bar.drawn(np.random.default_rng(seed), ()) for seed in range(8)]
    resonances = [math.sqrt(bar.spring / bar.mass) / (2 * math.pi) for bar in drawn]
    assert max(resonances) > 8 * min(resonances)
