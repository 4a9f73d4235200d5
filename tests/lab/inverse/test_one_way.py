"""Shafts that are driven in one direction, in which dry friction is a constant torque: the speed is given in closed
form, and the torque follows from it."""

from __future__ import annotations

import logging

import numpy as np
import pytest

from lostmotion.drivers.recording import Recording
from lostmotion.lab import experiments, explain, open_executor
from lostmotion.lab.report.verdict import of_explanation
from lostmotion.lab.results import Explanation
from lostmotion.model import build_model

J, B, C = 2e-3, 0.01, 0.4
"""kg m², N m s/rad, N m"""
TIMES = np.arange(0.0, 12.0, 5e-3)


def shaft(seed: int, direction: float, ripple: float = 0.0, constant: float = 0.0) -> Recording:
    """Its speed wanders between 2 and 38 rad/s; ripple: torque of two periods a turn [N m]; constant: [N m]."""
    rng = np.random.default_rng(seed)
    phase = rng.uniform(0, 2 * np.pi, 2)
    frequency, size = np.array([0.5, 1.3]) * rng.uniform(0.9, 1.1, 2), np.array([12.0, 6.0])
    w = 2 * np.pi * frequency
    turns = w * TIMES[:, None] + phase
    angle = direction * (20.0 * TIMES + (size / w * np.sin(turns)).sum(axis=1))
    speed = direction * (20.0 + (size * np.cos(turns)).sum(axis=1))
    acceleration = -direction * (size * w * np.sin(turns)).sum(axis=1)
    torque = J * acceleration + B * speed + C * np.sign(speed) + ripple * np.sin(2 * angle) + constant
    noise = rng.standard_normal((2, TIMES.size))
    columns = {"torque": torque + 5e-3 * noise[0], "position": angle + 1e-4 * noise[1]}
    return Recording(TIMES, columns, name=f"shaft{seed}.csv")


def found(directions: tuple[float, ...], ripple: float = 0.0, constant: float = 0.0) -> Explanation:
    """What is missing from a joint with viscous friction."""
    model = build_model("joint", ["viscous_friction"])
    with open_executor() as pool:
        made = [shaft(seed, direction, ripple, constant) for seed, direction in enumerate(directions)]
        return explain(model, experiments(model, made), pool)


def test_dry_friction_of_a_shaft_that_turns_one_way(caplog: pytest.LogCaptureFixture) -> None:
    """It is found, with its size, and a constant torque is said to look the same."""
    with caplog.at_level(logging.WARNING):
        explanation = found((1.0, 1.0, 1.0))
    assert explanation.missing == ("coulomb_friction",)
    (size,) = (one for one in explanation.best.estimates if one.name == "coulomb_friction.tau_c")
    assert size.low < C < size.high
    assert "turns in one direction" in caplog.text


def test_what_dry_friction_takes_beside_a_ripple() -> None:
    """It is first with most of the error, although its torque is constant."""
    explanation = found((1.0, 1.0, 1.0), 0.1)
    assert explanation.missing == ("coulomb_friction", "torque_ripple")
    assert explanation.share["coulomb_friction"] > 0.5


def test_dry_friction_of_a_shaft_that_turns_both_ways(caplog: pytest.LogCaptureFixture) -> None:
    """One direction in each recording: a constant torque is distinguished, and none is there."""
    with caplog.at_level(logging.WARNING):
        explanation = found((1.0, -1.0, 1.0))
    assert explanation.missing == ("coulomb_friction",)
    (bias,) = (one for one in explanation.best.estimates if one.name == "bias")
    assert bias.low < 0 < bias.high
    assert "constant torque" not in " ".join(of_explanation(explanation))
    assert "turns in one direction" not in caplog.text


def test_a_constant_torque_is_told() -> None:
    """As large as the friction that is named, it is no effect of the catalogue, but not passed over."""
    explanation = found((1.0, -1.0, 1.0), constant=-0.3)
    assert explanation.missing == ("coulomb_friction",)
    (said,) = (one for one in of_explanation(explanation) if "constant torque" in one)
    assert said.startswith("A constant torque of 0.30")
    assert said.endswith(" (95 %), acts as well, or is the zero of what was recorded.")


def test_an_arm_that_turns_back_at_the_end_of_its_only_recording() -> None:
    """Its last third moves the other way, in which what was a constant torque in the others is dry friction of the
    opposite sign: neither the friction nor the weight was named, and of such an arm a ripple.  The first third is for
    validation."""
    rng, times = np.random.default_rng(8), np.arange(0.0, 5.0, 0.01)
    speed = np.where(times < 3.3, 0.87, -1.05) * np.clip(np.abs(times - 3.3) / 0.1, 0, 1) * (1 - np.exp(-times / 0.05))
    speed += 0.03 * np.sin(9 * times)
    angle = np.cumsum(speed) * 0.01
    torque = 2.0 * np.gradient(speed, times) + 14.0 * np.tanh(speed / 0.02) + 39.0 * np.sin(angle)
    columns = {"position": angle, "torque": torque + 2.0 * rng.standard_normal(times.size)}
    held = experiments(build_model("joint"), [Recording(times, columns, name="arm.csv")])
    with open_executor() as pool:
        explanation = explain(build_model("joint"), held, pool)
    assert set(explanation.missing) == {"coulomb_friction", "gravity_torque"}
    sizes = {one.name: one.value for one in explanation.best.estimates}
    assert sizes["coulomb_friction.tau_c"] == pytest.approx(14.0, rel=0.1)
    assert sizes["gravity_torque.tau_g"] == pytest.approx(39.0, rel=0.1)
