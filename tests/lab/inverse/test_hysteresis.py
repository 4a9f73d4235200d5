"""Dry friction that is elastic near a reversal, made by Dahl's law in closed form.

Nothing of the lab's solver is used: the motion is given, and the friction follows from it at 4000 samples a second.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from lostmotion.daemon.cli import cli
from lostmotion.drivers.recording import Recording, write_recording
from lostmotion.lab.data.experiment import experiments
from lostmotion.lab.inverse.signals import Signals
from lostmotion.lab.inverse.torques import acceleration
from lostmotion.model import build_model

INERTIA, VISCOUS, COULOMB = 0.05, 0.3, 1.0
RISE = 0.02
FINE = 4000
FREQUENCIES, LENGTH = (0.31, 0.73, 1.37), 12.0


def moved(seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Times, angle, speed and acceleration of a sum of three sines, about 1 rad wide."""
    phases = np.random.default_rng(seed).uniform(0, 2 * np.pi, 3)
    t = np.arange(0, LENGTH, 1 / FINE)
    w = 2 * np.pi * np.array(FREQUENCIES)
    waves, sizes = np.multiply.outer(t, w) + phases, np.array([0.4, 0.2, 0.08])
    return t, np.sin(waves) @ sizes, np.cos(waves) @ (sizes * w), -np.sin(waves) @ (sizes * w**2)


def dahl(angle: np.ndarray, rise: float) -> np.ndarray:
    """The share of friction that is felt: what is missing of all of it falls by a factor e each rise."""
    z, found = 0.0, np.empty(angle.size)
    for i, step in enumerate(np.diff(angle, prepend=angle[0])):
        z = np.sign(step) + (z - np.sign(step)) * np.exp(-abs(step) / rise)
        found[i] = z
    return found


def measured(seed: int) -> Recording:
    """A joint with such friction at 200 samples a second, with noise on angle and torque and a slow disturbance."""
    rng = np.random.default_rng(100 + seed)
    t, angle, speed, acceleration = moved(seed)
    felt = dahl(angle, RISE)
    push = np.interp(t, np.arange(0, LENGTH + 0.2, 0.2), 0.02 * rng.standard_normal(61))
    torque = INERTIA * acceleration + VISCOUS * speed + COULOMB * felt + push
    every = slice(None, None, FINE // 200)
    count = t[every].size
    columns = {
        "torque": torque[every] + 0.01 * rng.standard_normal(count),
        "position": angle[every] + 1e-4 * rng.standard_normal(count),
    }
    return Recording(t[every], columns, {}, name=f"joint{seed}.csv")


def fitted(folder: Path, recordings: list[Recording], model: str) -> dict[str, Any]:
    """What the command line says."""
    (folder / "model.toml").write_text(model)
    names = []
    for one in recordings:
        write_recording(one, folder / one.name)
        names.append(str(folder / one.name))
    result = CliRunner().invoke(
        cli, ["lab", "fit", str(folder / "model.toml"), *names, "-o", str(folder / "out.toml"), "--json"]
    )
    assert result.exit_code == 0, result.output
    answer: dict[str, Any] = json.loads(result.stdout)
    return answer


@pytest.mark.slow
@pytest.mark.parametrize(("friction", "rise"), [(0.5, 0.05), (0.9, 0.01)])
def test_the_way_of_presliding(friction: float, rise: float, tmp_path: Path) -> None:
    """Added to viscous and Coulomb friction, presliding takes the error to the noise and the disturbance, and tells
    over which way friction builds up, from first values a factor of two off."""
    values = f"presliding_friction.tau_p = {friction}\npresliding_friction.x_p = {rise}\n"
    effects = '["viscous_friction", "coulomb_friction", "presliding_friction"]'
    model = f'base = "joint"\neffects = {effects}\n[parameters]\ncoulomb_friction.tau_c = 0.8\n{values}'
    answer = fitted(tmp_path, [measured(seed) for seed in (1, 2, 3)], model)
    found = {name: value for name, (value, *_) in answer["parameters"].items()}
    assert found["presliding_friction.x_p"] == pytest.approx(RISE, rel=0.1)
    assert found["presliding_friction.tau_p"] == pytest.approx(COULOMB, rel=0.05)
    assert found["coulomb_friction.tau_c"] == pytest.approx(COULOMB, rel=0.05)
    assert answer["rms"]["torque"] < 0.03


def test_torque_along_a_measured_motion() -> None:
    """The torque that the model needs for a measured motion is that of the closed form, after the first reversal."""
    values = {"J": INERTIA, "coulomb_friction.tau_c": COULOMB, "coulomb_friction.omega_0": 0.01}
    values |= {f"presliding_friction.{name}": v for name, v in (("tau_p", COULOMB), ("x_p", RISE), ("omega_0", 0.01))}
    model = build_model("joint", ["coulomb_friction", "presliding_friction"], values)
    (experiment,) = experiments(model, [measured(1)])
    signals = Signals.of(experiment)
    found = -INERTIA * acceleration(model, signals, np.zeros(signals.time.size))
    t, angle, *_ = moved(1)
    off = (found - np.interp(signals.time, t, COULOMB * dahl(angle, RISE)))[signals.time > 2.0]
    assert np.sqrt(np.mean(off**2)) < 0.03
