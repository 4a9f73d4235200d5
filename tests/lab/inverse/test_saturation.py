"""Servos whose drive is full elsewhere than in their model, simulated here, not by the lab's solver."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from lostmotion.drivers.recording import Recording
from lostmotion.lab.data.experiment import experiments
from lostmotion.lab.inverse.saturation import with_saturation
from lostmotion.lab.models import modelfile
from tests.lab.inverse.test_inverse import explained

STIFFNESS, DAMPING, INERTIA = 15.0, 1.2, 0.03
"""N m/rad, N m s/rad, kg m²"""
COULOMB, WEIGHT = 0.6, 0.4
"""N m"""
BARE = 'base = "servo"\neffects = ["viscous_friction"]\n'
DEFAULT_RAD = 1 / (32 * 0.165)
"""Error at which the drive of the default model is full."""


def leg(seed: int, full_at: float, swing: float = 0.6, length: float = 8.0) -> Recording:
    """A joint that follows triangles, which get faster, with dry friction (Karnopp 1985) and a weight, in steps of 0.5
    ms; full_at: the error at which its drive is full [rad]."""
    rng = np.random.default_rng(seed)
    step, every = 5e-4, 10
    times = np.arange(0.0, length, step)
    turned = 0.3 * times + 0.5 * (1.6 - 0.3) / length * times**2 + rng.uniform(0, 1)
    command = 2 * swing / math.pi * np.arcsin(np.sin(2 * math.pi * turned))
    angle, speed, angles = float(command[0]), 0.0, []
    for wanted in command.tolist():
        angles.append(angle)
        drive = STIFFNESS * min(max(wanted - angle, -full_at), full_at)
        torque = drive - DAMPING * speed - WEIGHT * math.sin(angle + 0.3)
        if speed == 0.0 and abs(torque) < COULOMB:
            continue
        before = speed
        speed += step / INERTIA * (torque - math.copysign(COULOMB, speed or torque))
        speed = 0.0 if before * speed < 0 else speed
        angle += step * speed
    position = np.array(angles[::every]) + 3e-4 * rng.standard_normal(len(angles[::every]))
    return Recording(times[::every], {"command": command[::every], "position": position}, name=f"leg{seed}.csv")


@pytest.mark.parametrize(
    ("full_at", "stated", "is_limited"),
    [(math.inf, "", False), (DEFAULT_RAD, "", True), (DEFAULT_RAD / 3, "", True), (math.inf, "cap = 1.0\n", True)],
)
def test_a_limit_that_the_motion_contradicts_is_left_out(
    full_at: float, stated: str, is_limited: bool, caplog: pytest.LogCaptureFixture
) -> None:
    """Of a drive in proportion the default limit is left out, and a warning says so; the limit of a drive that has it,
    or a smaller one, is kept, as is one that the model file states."""
    model = modelfile.loads(f"{BARE}[parameters]\n{stated}", "model.toml").build()
    recordings = experiments(model, [leg(seed, full_at) for seed in (1, 2)])
    error = max(float(np.abs(one.drive.position(one.time) - one.measured["position"]).max()) for one in recordings)  # type: ignore[union-attr]
    assert error > 1.5 * DEFAULT_RAD
    found = with_saturation(model, recordings)
    assert (found == model) is is_limited
    assert ("state cap and error_gain" in caplog.text) is not is_limited
    assert is_limited or found.parameters["cap"].value > error / DEFAULT_RAD


def test_recordings_without_a_command_do_not_tell_the_limit() -> None:
    """Of a servo that is let go nothing is compared."""
    model = modelfile.loads(BARE, "model.toml").build()
    recordings = experiments(model, [leg(1, math.inf), leg(2, math.inf)])
    free = [replace(one, drive=None) for one in recordings]
    assert with_saturation(model, free) == model
    assert with_saturation(model, [free[0], recordings[1]]) == with_saturation(model, recordings[1:]) != model


@pytest.mark.slow
def test_what_a_limit_that_is_not_there_hid_is_found(tmp_path: Path) -> None:
    """A leg whose slow motion is fitted stays below the limit of the default model; the fast motion that is kept for
    judging does not, and shows friction and weight."""
    recordings = [leg(seed, math.inf, swing, 4.0) for seed, swing in ((1, 0.28), (3, 0.6))]
    answer = explained(tmp_path, BARE, [replace(one, name=f"leg{at}.csv") for at, one in enumerate(recordings)])
    assert set(answer["missing"]) == {"coulomb_friction", "gravity_torque"}
    assert answer["error"]["after"] < 2e-3 < 0.03 < answer["error"]["before"]
