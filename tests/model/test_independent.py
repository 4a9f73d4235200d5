"""The compiled model against a second, independent solution of the same equations (independent.py)."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from lostmotion.model import HandWaved, Model, Sampled, Sine, build_model, catalogue
from lostmotion.model.motion import FloatArray
from tests.model import independent

TIMES = np.arange(0, 201) * 1e-3
MOTION = HandWaved(seed=3, amplitude_rad=0.1, low_hz=2.0, high_hz=7.0)
JOINT_EFFECTS = [e.id for e in catalogue() if "joint" in e.bases]
SERVO_EFFECTS = [e.id for e in catalogue() if "servo" in e.bases]
PLAY_EFFECTS = [e.id for e in catalogue() if "play" in e.bases and e.id != "clock_skew"]


def values(model: Model) -> dict[str, float]:
    """The model's parameters as plain numbers."""
    return {name: parameter.value for name, parameter in model.parameters.items()}


@lru_cache(maxsize=64)  # LSODA asks again and again of one time
def command(t: float) -> float:
    """The motion at one instant."""
    return float(MOTION.position(np.array(t)))


@lru_cache(maxsize=64)
def rate(t: float) -> float:
    """Its rate at one instant."""
    return float(MOTION.velocity(np.array(t)))


def acceleration(t: float) -> float:
    """Its second derivative at one instant."""
    return float(MOTION.acceleration(np.array(t)))


def distance(one: np.ndarray, other: np.ndarray) -> float:
    """Root mean square difference over the root mean square."""
    return float(np.sqrt(np.mean((one - other) ** 2) / np.mean(other**2)))


def check_play(effects: list[str], **changed: float) -> None:
    """Holds the play base with some effects against LSODA, and makes sure that the effects show."""
    model = build_model("play", effects, {"bias": 0.1, **changed})
    ours = model.simulate(MOTION, TIMES)
    theirs = independent.Play(values(model), command, rate, acceleration).solve(TIMES)
    plain = build_model("play", (), {"bias": 0.1}).simulate(MOTION, TIMES)
    assert distance(ours["position"], theirs["position"]) < 1e-5
    assert distance(ours["accel"], theirs["accel"]) < 2e-3
    if effects:
        assert distance(ours["accel"], plain["accel"]) > 20 * distance(ours["accel"], theirs["accel"])


@pytest.mark.slow
def test_play_base() -> None:
    """Eqs. 1-7 without any effect agree with LSODA."""
    check_play([])


@pytest.mark.slow
@pytest.mark.parametrize("effect", PLAY_EFFECTS)
def test_play_with_each_effect(effect: str) -> None:
    """Every effect on the play base agrees with LSODA, and is not confused with no effect."""
    changed = {"sensor_saturation.a_max": 3.0} if effect == "sensor_saturation" else {}
    if effect == "second_mode":
        changed = {"second_mode.zeta2": 0.05}
    check_play([effect], **changed)


@pytest.mark.slow
def test_play_with_many_effects() -> None:
    """Effects of every kind at once: they compose as the equations do."""
    check_play(
        ["sensor_lag", "hardening_spring", "coulomb_friction", "actuator_lag", "gravity_torque", "shaft_compliance"]
    )


@pytest.mark.slow
@pytest.mark.parametrize("effect", [None, "coulomb_friction", "hardening_spring", "quadratic_damping"])
def test_oscillator(effect: str | None) -> None:
    """The driven oscillator agrees with LSODA, alone and with the effects on it."""
    force = Sine(40.0, 1.0)
    width = {"coulomb_friction.omega_0": 5e-3} if effect == "coulomb_friction" else {}
    model = build_model("oscillator", [effect] if effect else [], {"bias": 0.05, **width})
    ours = model.simulate(force, TIMES, [1e-3, 0.0])["displacement"]
    w = 2 * math.pi * 40
    theirs = independent.oscillator(values(model), lambda t: math.sin(w * t), [1e-3, 0.0], TIMES)
    assert distance(ours, theirs) < 1e-4


@pytest.mark.parametrize("effect", [None, *JOINT_EFFECTS])
def test_joint(effect: str | None) -> None:
    """The joint under a torque agrees with LSODA, alone and with each effect."""
    torque = Sine(2.0, 2e-3)
    model = build_model("joint", [effect] if effect else [], {"bias": 1e-4})
    start = [0.2, -0.5] + [0.0] * (len(model.state_names) - 2)
    ours = model.simulate(torque, TIMES, start)["position"]
    w = 2 * math.pi * 2
    theirs = independent.joint(values(model), lambda t: 2e-3 * math.sin(w * t), [0.2, -0.5], TIMES)
    assert distance(ours, theirs) < 1e-4


@pytest.mark.parametrize("effect", [None, *SERVO_EFFECTS])
def test_servo(effect: str | None) -> None:
    """The servo following a command agrees with LSODA, alone and with each effect; half of its speed is the limit."""
    given = {"velocity_limit.omega_max": max(map(rate, TIMES)) / 2} if effect == "velocity_limit" else {}
    model = build_model("servo", [effect] if effect else [], {"cap": 0.3, **given})
    ours = model.simulate(MOTION, TIMES)["position"]
    late = -values(model).get("command_delay.T", 0.0)
    theirs = independent.servo(values(model), command, [command(late), rate(late), command(late)], TIMES)
    assert distance(ours, theirs) < 1e-4


INERTIA, WEIGHT, WIDTH = 2e-4, 1.4e-3, 2e-3
SWING = np.arange(0.0, 12.0, 0.02)


@lru_cache
def by_radau(start: float, rubs: float) -> FloatArray:
    """Such a pendulum's angle (N,), solved once for all steps of the model."""
    law = lambda t, x: [x[1], -(WEIGHT * np.sin(x[0]) + rubs * np.tanh(x[1] / WIDTH)) / INERTIA]  # noqa: E731
    found = solve_ivp(law, (0, SWING[-1]), [start, 0.0], "Radau", SWING, rtol=1e-10, atol=1e-12)
    return np.asarray(found.y[0])


def pendulum(start: float, step: float | None, rubs: float = 1.5e-4) -> tuple[FloatArray, FloatArray, float]:
    """A pendulum with dry friction for 12 s: by SciPy's Radau, by the model, and the model's step [s]."""
    friction = {"tau_c": rubs, "omega_0": WIDTH}
    model = build_model(
        "joint", ["gravity_torque", "coulomb_friction"],
        {"J": INERTIA, "gravity_torque.tau_g": WEIGHT} | {f"coulomb_friction.{k}": v for k, v in friction.items()},
    )  # fmt: skip
    run = model.simulate(None, SWING, [start, 0.0], substep_s=step)
    return by_radau(start, rubs), run["position"], run.substep_s


@pytest.mark.parametrize("step", [None, 4e-3, 16e-3])
@pytest.mark.parametrize("start", [1.2, 0.3])
def test_dry_friction_changes_sign_within_long_steps(start: float, step: float | None) -> None:
    """Steps are short where the speed changes its sign, and nowhere else: a pendulum that stops by dry friction is
    followed to 1e-4 rad in steps of 16 ms, twenty times as long as the friction's time (one of 16 ms alone: 7e-3)."""
    exact, found, used = pendulum(start, step)
    assert used >= 2e-3
    assert np.abs(found - exact).max() < 1e-4


def test_a_joint_that_sticks() -> None:
    """Held by a friction that would stop it in 0.02 ms, it creeps as slowly as the width of the change of sign says."""
    exact, found, _ = pendulum(1e-3, 16e-3, rubs=2e-2)
    assert np.abs(found - exact).max() < 1e-8
    assert found[-1] == pytest.approx(1e-3, rel=0.01)


def test_a_servo_that_sticks_behind_a_lag() -> None:
    """It holds a weight for much of six seconds while the command lags: 1e-5 rad at most from Radau."""
    times = np.arange(0.0, 6.0, 0.02)
    given = {
        "coulomb_friction.tau_c": 0.5, "actuator_lag.T": 0.05, "gravity_torque.tau_g": 0.8, "kt": 2.0,
        "coulomb_friction.omega_0": 2e-3,
    }  # fmt: skip
    model = build_model("servo", ["coulomb_friction", "actuator_lag", "gravity_torque"], given)
    p = values(model)
    goal = lambda t: 0.6 * np.sin(0.7 * t) + 0.25 * np.sin(1.9 * t)  # noqa: E731

    def law(t: float, x: FloatArray) -> list[float]:
        duty = p["kp"] * p["error_gain"] * (x[2] - x[0])
        motor = p["kt"] * (duty * p["U"] - p["kt"] * x[1]) / p["R"]
        held = 0.8 * np.sin(x[0]) + 0.5 * np.tanh(x[1] / 2e-3)
        return [x[1], (motor - held) / p["J"], (goal(t) - x[2]) / 0.05]

    start = [0.0, 0.0, 0.0]
    exact = solve_ivp(law, (0, 6), start, "Radau", times, rtol=1e-10, atol=1e-12)
    found = model.simulate(Sampled(times, goal(times)), times, start)["position"]
    assert np.abs(found - exact.y[0]).max() < 1e-5
