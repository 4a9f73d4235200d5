"""The unit of an angle that stands beside a torque without one, on an arm whose torque is computed in closed form."""

from __future__ import annotations

import logging
from pathlib import Path

import numpy as np
import pytest

from lostmotion.lab.models.modelfile import load
from tests.daemon.cli_world import call

WEIGHT, DRY, INERTIA = 38.0, 12.0, 2.4


def arm(path: Path, speed: float, turns_weight: float, unit: str = "") -> Path:
    """An arm that is turned through 100 degrees at a speed [deg/s], with a start and a stop of half a second; a weight
    that turns so often in one turn of the arm; unit: behind the name of the angle."""
    rng, time = np.random.default_rng(abs(int(speed))), np.arange(0.0, 100 / abs(speed), 0.02)
    ramp = np.clip(np.minimum(time, time[-1] - time) / 0.5, 0.0, 1.0)
    angle = np.cumsum(speed * ramp) * 0.02
    rate, rad = np.deg2rad(speed * ramp), np.deg2rad(angle)
    torque = INERTIA * np.gradient(rate, time) + DRY * np.tanh(rate / 1e-3) + WEIGHT * np.sin(turns_weight * rad)
    columns = np.stack([time, angle, torque + 0.5 * rng.standard_normal(time.size)], axis=1)
    np.savetxt(path, columns, "%.4f", ",", header=f"t,angle{unit},torque", comments="")
    return path


@pytest.mark.parametrize(
    ("turns_weight", "speeds", "unit", "is_taken"),
    [
        (1.0, (20, -30, 40, -25), "", True),
        (1.0, (20, -30, 40, -25), " (rad)", False),
        (180 / np.pi, (20, -30, 40, -25), "", False),  # rad of a shaft with a weight
        (0.0, (20, -30, 40, -25), "", False),
        (1.0, (20, 30, 40, 25), "", False),  # in one direction anything that changes may look like a weight
    ],
)
def test_a_weight_tells_the_unit(
    turns_weight: float, speeds: tuple[int, ...], unit: str, is_taken: bool,
    tmp_path: Path, caplog: pytest.LogCaptureFixture,
) -> None:  # fmt: skip
    files = [arm(tmp_path / f"arm{at}.csv", speed, turns_weight, unit) for at, speed in enumerate(speeds)]
    model, wanted = tmp_path / "arm.toml", tmp_path / "fitted.toml"
    model.write_text('base = "joint"\neffects = ["gravity_torque", "coulomb_friction"]\n')
    with caplog.at_level(logging.WARNING):
        done = call("lab", "fit", model, *files, "-o", wanted)
    assert done.exit_code == 0, done.output
    assert ("the angle is taken as deg" in caplog.text) is is_taken
    if is_taken:
        values = {name: one.value for name, one in load(wanted).build().parameters.items()}
        assert values["gravity_torque.tau_g"] == pytest.approx(WEIGHT, rel=0.03)
        assert values["coulomb_friction.tau_c"] == pytest.approx(DRY, rel=0.05)


def test_a_torque_of_zeros_tells_nothing(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """A log may have a column of zeros where nothing measures the torque: the swing is free, with its angle in rad."""
    time = np.arange(0.0, 10.0, 0.02)
    angle = 60.0 * np.exp(-0.1 * time) * np.cos(3.0 * time)
    file, model = tmp_path / "swing.csv", tmp_path / "swing.toml"
    table = np.stack([time, angle, 0.0 * time], axis=1)
    np.savetxt(file, table, "%.4f", ",", header="t,angle,torque", comments="")
    model.write_text('base = "joint"\neffects = ["gravity_torque", "viscous_friction"]\n')
    with caplog.at_level(logging.WARNING):
        done = call("lab", "fit", model, file, "-o", tmp_path / "fitted.toml")
    assert done.exit_code == 0, done.output
    assert "the torque is zero throughout" in caplog.text
    assert "the angle is taken as deg" not in caplog.text
