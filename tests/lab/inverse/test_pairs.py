"""Effects that predict nothing one without the other: recordings simulated here, asked through the command line."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from lostmotion.drivers.recording import Recording
from tests.lab.inverse.test_output_error import explained

WEIGHT, LOSS, NOISE_RAD = 1.7, 0.45, 8e-4
ERROR_GAIN, SUPPLY, TORQUE_CONSTANT, WINDING, INERTIA = 0.165, 12.0, 1.2, 4.4, 0.06


def lifting_servo(gain: int, seed: int) -> Recording:
    """A servo with a weak gain lifts a heavy arm and lowers it for 2.5 seconds, in steps of 0.5 ms; its friction,
    0.45 of the motor's torque, sticks (Karnopp 1985).  Of two seconds the weight would be named alone."""
    step, every = 5e-4, 20
    times = np.arange(0.0, 2.5, step)
    command = 1.57 * (1 - np.cos(math.pi * np.minimum(times, 1.25) / 1.25)) / 2
    command -= 0.16 * (1 - np.cos(math.pi * np.maximum(times - 1.25, 0.0) / 1.25))
    angle, speed, angles = 0.0, 0.0, []
    for wanted in command.tolist():
        duty = min(max(gain * ERROR_GAIN * (wanted - angle), -1.0), 1.0)
        angles.append(angle)
        motor = TORQUE_CONSTANT * (SUPPLY * duty - TORQUE_CONSTANT * speed) / WINDING
        torque, friction = motor - WEIGHT * math.sin(angle), LOSS * abs(motor)
        if speed == 0.0 and abs(torque) < friction:
            continue
        before = speed
        speed += step / INERTIA * (torque - math.copysign(friction, speed or torque))
        speed = 0.0 if before * speed < 0 else speed
        angle += step * speed
    noise = NOISE_RAD * np.random.default_rng(seed).standard_normal(len(angles[::every]))
    columns = {"command": command[::every], "position": np.array(angles[::every]) + noise}
    return Recording(times[::every], columns, {"kp": gain}, {}, 0, f"lift{gain}.csv")


def dropped_arm(start: float, seed: int) -> Recording:
    """An arm that is let go 20 degrees from where it hangs, with viscous and Coulomb friction; J is 0.001 kg m²."""
    times = np.arange(0.0, 1.2, 4e-3)

    def moved(t: float, x: np.ndarray) -> list[float]:
        return [x[1], -(0.14 * math.sin(x[0]) + 1.7e-3 * x[1] + 3.4e-3 * math.tanh(x[1] / 2e-3)) / 1e-3]

    angle = solve_ivp(moved, (0.0, 1.2), [start, 0.0], "LSODA", times, rtol=1e-8, atol=1e-10).y[0]
    noise = 4e-4 * np.random.default_rng(seed).standard_normal(times.size)
    return Recording(times, {"position": angle + noise}, {}, {}, 0, f"drop{seed}.csv")


@pytest.mark.slow
def test_weight_and_friction_of_a_servo_that_lifts(tmp_path: Path) -> None:
    """Neither is named alone, as the fit with one predicts no other part of the motion; both are named as a pair."""
    answer = explained(tmp_path, 'base = "servo"', [lifting_servo(gain, gain) for gain in (8, 16, 12)])
    assert answer["missing"] == ["gravity_torque", "load_dependent_friction"]
    assert answer["parameters"]["load_dependent_friction.mu"][0] == pytest.approx(LOSS, rel=0.1)
    assert answer["error"]["after"] < 2 * NOISE_RAD


@pytest.mark.slow
def test_weight_of_a_small_swing_is_no_spring(tmp_path: Path) -> None:
    """Of a swing of 20 degrees a constant torque and the phase of the weight are hardly distinguished; it is the
    weight that is named all the same."""
    answer = explained(tmp_path, 'base = "joint"', [dropped_arm(-0.34, 1), dropped_arm(0.35, 2)])
    assert set(answer["missing"]) == {"gravity_torque", "coulomb_friction", "viscous_friction"}


@pytest.mark.slow
def test_a_pendulum_that_falls_from_the_upright_has_its_weight(tmp_path: Path) -> None:
    """Its swing with the weight alone is out of phase, and has a larger error than with a spring; the weight explains
    most of the acceleration, and is the first of the pair that is named."""
    times = np.arange(0.0, 12.0, 0.015)
    found = solve_ivp(
        lambda _, x: [x[1], -39.0 * math.sin(x[0]) - 0.5 * x[1]], (0.0, 12.0), [3.09, 0.0], "LSODA", times, rtol=1e-8,
        atol=1e-10,
    )  # fmt: skip
    angle = found.y[0] + 3e-3 * np.random.default_rng(0).standard_normal(times.size)
    answer = explained(tmp_path, 'base = "joint"', [Recording(times, {"position": angle}, {}, {}, 0, "fall.csv")])
    assert set(answer["missing"]) == {"gravity_torque", "viscous_friction"}
    assert answer["error"]["after"] < 2 * 3e-3


@pytest.mark.slow
def test_coarse_steps_of_an_encoder_hide_no_friction(tmp_path: Path) -> None:
    """A pendulum swings by 100 degrees, so that its period depends on its amplitude, and the encoder has steps of 0.01
    rad.  Coulomb friction and drag damp as viscous friction does, which is named first.  A fit with the pair begins in
    the initial state of that fit, and on a growing horizon: the swing from the measured state is soon out of phase."""
    times = np.arange(0.0, 24.0, 0.01)
    friction, drag, viscous = 0.35, 7e-3, 0.04

    def moved(t: float, x: np.ndarray) -> list[float]:
        lost = viscous * x[1] + friction * math.tanh(x[1] / 5e-3) + drag * x[1] * abs(x[1])
        return [x[1], -83.3 * math.sin(x[0]) - lost]

    angle = solve_ivp(moved, (0.0, 24.0), [1.7, -2.0], "LSODA", times, rtol=1e-8, atol=1e-10).y[0]
    swing = Recording(times, {"position": np.round(angle / 0.01) * 0.01}, {}, {}, 0, "swing.csv")
    answer = explained(tmp_path, 'base = "joint"\neffects = ["gravity_torque"]', [swing])
    assert set(answer["missing"]) >= {"coulomb_friction", "quadratic_damping"}
    assert answer["error"]["after"] < 1.2 * 0.01 / math.sqrt(12)


@pytest.mark.slow
def test_drag_and_dry_friction_take_the_place_of_viscous_friction(tmp_path: Path) -> None:
    """Of a pendulum that falls from the upright.  Viscous friction is named first; with drag and Coulomb friction it is
    much smaller.  While the fit with one more effect began with the present values of all others, it ended at 900 times
    the squared error, and viscous friction alone was named, with 50 times the noise left."""
    times, noise = np.arange(0.0, 30.0, 0.01), 1e-3

    def moved(t: float, x: np.ndarray) -> list[float]:
        lost = 0.72 * math.tanh(x[1] / 1e-3) + 7.8e-3 * x[1] * abs(x[1])
        return [x[1], -87.0 * math.sin(x[0]) - lost]

    angle = solve_ivp(moved, (0.0, 30.0), [2.9, 0.0], "LSODA", times, rtol=1e-8, atol=1e-9).y[0]
    swing = Recording(times, {"position": angle + noise * np.random.default_rng(1).standard_normal(times.size)}, {}, {},
                      0, "fall.csv")  # fmt: skip
    answer = explained(tmp_path, 'base = "joint"\neffects = ["gravity_torque"]', [swing])
    assert set(answer["missing"]) == {"coulomb_friction", "quadratic_damping"}
    assert answer["error"]["after"] < 1.2 * noise
