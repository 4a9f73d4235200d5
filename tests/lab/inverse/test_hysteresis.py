"""Dry friction that is elastic near a reversal, or acts behind a play, made in closed form.

Nothing of the lab's solver is used: the motion is given, and the friction follows from it at 4000 samples a second.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from lostmotion.daemon.cli import cli
from lostmotion.drivers.recording import Recording, write_recording
from lostmotion.lab.data.experiment import experiments
from lostmotion.lab.inverse.signals import Signals
from lostmotion.lab.inverse.torques import acceleration, accelerations
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


def behind_play(angle: np.ndarray, play: float, contact: float) -> np.ndarray:
    """The same behind a play, with a contact that builds up evenly (play operator, step by step)."""
    end, y = play / 2 + contact, 0.0
    found = np.empty(angle.size)
    for i, step in enumerate(np.diff(angle, prepend=angle[0])):
        y = min(max(y + step, -end), end)
        found[i] = np.sign(y) * max(abs(y) - play / 2, 0.0) / contact
    return found


def elastic(angle: np.ndarray) -> np.ndarray:
    """Dahl's law."""
    return dahl(angle, RISE)


def measured(seed: int, law: Callable[[np.ndarray], np.ndarray] = elastic) -> Recording:
    """A joint with such friction at 200 samples a second, with noise on angle and torque and a slow disturbance."""
    rng = np.random.default_rng(100 + seed)
    t, angle, speed, acceleration = moved(seed)
    felt = law(angle)
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
    """What ``lab fit`` says."""
    return asked("fit", folder, recordings, model, "-o", str(folder / "out.toml"))


def asked(command: str, folder: Path, recordings: list[Recording], model: str, *options: str) -> dict[str, Any]:
    """What a command of the lab says."""
    (folder / "model.toml").write_text(model)
    names = []
    for one in recordings:
        write_recording(one, folder / one.name)
        names.append(str(folder / one.name))
    result = CliRunner().invoke(cli, ["lab", command, str(folder / "model.toml"), *names, *options, "--json"])
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


@pytest.mark.slow
def test_friction_behind_a_play_is_named(tmp_path: Path) -> None:
    """A friction damper with a play of 0.12 rad, behind which the friction builds up evenly over 0.05, is no joint with
    Coulomb friction and a spring: the interval of the play contains it, and the friction is found to 5 %."""
    recordings = [measured(seed, partial(behind_play, play=0.12, contact=0.05)) for seed in (1, 2, 3)]
    answer = asked("explain", tmp_path, recordings, 'base = "joint"\n')
    assert {*answer["missing"]} == {"viscous_friction", "friction_behind_play"}
    found = next(one["parameters"] for one in answer["ranking"] if one["effect"] == "friction_behind_play")
    assert found["e"][1] < 0.12 < found["e"][2] < 0.15
    assert found["tau_p"][0] == pytest.approx(COULOMB, rel=0.05)


@pytest.mark.slow
def test_elastic_friction_is_no_play(tmp_path: Path) -> None:
    """Friction that builds up over 20 mrad from the reversal on has no play before it."""
    answer = asked("explain", tmp_path, [measured(seed) for seed in (1, 2, 3)], 'base = "joint"\n')
    assert {*answer["missing"]} == {"viscous_friction", "coulomb_friction"}


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


def test_models_side_by_side_are_as_each_alone() -> None:
    """Those of one regression, of which some need more steps between two samples, and one has no states; also where
    each counts its angle from another zero."""
    (experiment,) = experiments(build_model("joint"), [measured(1)])
    signals, names = Signals.of(experiment), ["gravity_torque", "presliding_friction"]
    models = [
        build_model("joint", names, {"presliding_friction.x_p": rise, "gravity_torque.tau_g": 0.2 + rise})
        for rise in (0.02, 0.0201, 0.005, 0.02, 0.3)
    ] + [build_model("joint")]
    load, moved_by = np.zeros(signals.time.size), [signals.shifted(0.1 * k) for k in range(len(models))]
    found = accelerations(models, moved_by, load)
    for model, one, each in zip(models, moved_by, found, strict=True):
        assert each == pytest.approx(acceleration(model, one, load), rel=1e-9, abs=1e-9)
