"""Dry friction that is elastic near a reversal or acts through play, made by the operators of hysteresis themselves.

Nothing of the lab's solver is used: the motion is given, and the friction follows from its turning points (stop and
play operators; Dahl's law in closed form), at 4000 samples a second.
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
from lostmotion.lab.inverse.torques import needed
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


def through_play(angle: np.ndarray, gap: float, rise: float) -> np.ndarray:
    """The share of friction that is felt: an elastic slider (stop operator) behind a gap."""
    limit, y, found = gap / 2 + rise, 0.0, np.empty(angle.size)
    for i, step in enumerate(np.diff(angle, prepend=angle[0])):
        y = min(max(y + step, -limit), limit)
        found[i] = np.sign(y) * min(max((abs(y) - gap / 2) / rise, 0.0), 1.0)
    return found


def dahl(angle: np.ndarray, rise: float) -> np.ndarray:
    """The same of Dahl's law: the way to the end falls by a factor e each rise."""
    z, found = 0.0, np.empty(angle.size)
    for i, step in enumerate(np.diff(angle, prepend=angle[0])):
        z = np.sign(step) + (z - np.sign(step)) * np.exp(-abs(step) / rise)
        found[i] = z
    return found


def measured(seed: int, gap: float | None, rise: float = RISE) -> Recording:
    """A joint with such friction at 200 samples a second, with noise on angle and torque and a slow disturbance; gap:
    zero for Dahl's law, None for friction that changes sign at once."""
    rng = np.random.default_rng(100 + seed)
    t, angle, speed, acceleration = moved(seed)
    felt = np.sign(speed) if gap is None else through_play(angle, gap, rise) if gap else dahl(angle, rise)
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
@pytest.mark.parametrize(("gap", "name"), [(0.03, "friction_backlash"), (0.12, "friction_backlash"),
                                           (0.0, "presliding_friction")])  # fmt: skip
def test_the_size_of_the_play(gap: float, name: str, tmp_path: Path) -> None:
    """Added to viscous and Coulomb friction, the effect takes the error to the noise and the disturbance, and tells how
    far the joint goes before friction is felt: to a tenth."""
    values = f"coulomb_friction.tau_c = 0.8\n{name}.tau_p = 0.5\n{name}.x_p = 0.05\n"
    values += f"{name}.gap = 0.06\n" if gap else ""
    model = f'base = "joint"\neffects = ["viscous_friction", "coulomb_friction", "{name}"]\n[parameters]\n{values}'
    answer = fitted(tmp_path, [measured(seed, gap) for seed in (1, 2, 3)], model)
    found = {full.removeprefix(f"{name}."): value for full, (value, *_) in answer["parameters"].items()}
    assert found.get("gap", 0.0) / 2 + found["x_p"] == pytest.approx(gap / 2 + RISE, rel=0.1)
    assert found["coulomb_friction.tau_c"] == pytest.approx(COULOMB, rel=0.05)
    assert answer["rms"]["torque"] < 0.03


@pytest.mark.parametrize("gap", [0.0, 0.05])
def test_torque_along_a_measured_motion(gap: float) -> None:
    """The torque that the model needs for a measured motion is that of the operators, after the first reversal."""
    name = "friction_backlash" if gap else "presliding_friction"
    values = {"J": INERTIA, "coulomb_friction.tau_c": COULOMB, f"{name}.tau_p": COULOMB, f"{name}.x_p": RISE}
    values |= {"coulomb_friction.omega_0": 0.01, f"{name}.omega_0": 0.01} | ({f"{name}.gap": gap} if gap else {})
    model = build_model("joint", ["coulomb_friction", name], values)
    (experiment,) = experiments(model, [measured(1, gap)])
    signals = Signals.of(experiment)
    found = needed(model, signals, np.zeros(signals.time.size)) - INERTIA * signals.acceleration
    t, angle, *_ = moved(1)
    exact = COULOMB * (through_play(angle, gap, RISE) if gap else dahl(angle, RISE))
    off = (found - np.interp(signals.time, t, exact))[signals.time > 2.0]
    assert np.sqrt(np.mean(off**2)) < 0.03
