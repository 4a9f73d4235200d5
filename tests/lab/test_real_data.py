"""Measurements made by others: the lab finds the effects that are known to be in them, at the error that is known.

``bench.real`` asks for all of them; here are those that are answered in seconds, and one that is fitted by hand: what
the command does not print is its error in the figures that were published.
"""

from __future__ import annotations

import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from bench.real import asked

from lostmotion.drivers.recording import Recording, read_recording, write_recording
from lostmotion.lab.data.experiment import experiments
from lostmotion.lab.shooting.continuation import fitted
from lostmotion.lab.shooting.initial_state import segment_of
from lostmotion.lab.shooting.parameters import Unknowns
from lostmotion.lab.shooting.task import Task, coarse_substep
from lostmotion.model import Parameter, build_model
from lostmotion.model.motion import FloatArray
from tests.conftest import Measurements

pytestmark = pytest.mark.slow


def rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def beginning(path: Path, share: float, folder: Path) -> str:
    """The first part of a recording, in another file."""
    whole = read_recording(path)
    many = int(share * whole.time.size)
    columns = {name: values[:many] for name, values in whole.columns.items()}
    write_recording(replace(whole, time=whole.time[:many], columns=columns), folder / path.name)
    return str(folder / path.name)


def test_silverbox_is_a_hardening_spring(real_data: Measurements, tmp_path: Path) -> None:
    """From two seconds of a multisine: the spring hardens, and the error of an arrow falls to an eighth at least."""
    parts = {"multisine_1": 0.1, "arrow_test": 0.15}
    paths = [beginning(real_data("silverbox") / f"{name}.csv", share, tmp_path) for name, share in parts.items()]
    answer = asked("silverbox", {"model": 'base = "oscillator"', "recordings": paths}, tmp_path, "600s").document

    assert answer["missing"][0] == "hardening_spring"
    assert answer["error"]["after"] < 0.125 * answer["error"]["before"]


PUBLISHED = {
    "emps": ("coulomb_friction", {"J": (95.1, 0.03), "viscous_friction.b_v": (203.5, 0.1)}, 0.32),
    "ur10e_joint1": ("viscous_friction coulomb_friction", {}, 0.1),
    "lorenz_jm": ("coulomb_friction viscous_friction", {}, 0.1),
}
"""Of cases of ``bench.real``: what is surely in them, parameters that were published with tolerances (EMPS: Janot,
Gautier and Brunot 2019), and the largest share of the error that may be left."""


@pytest.mark.parametrize("name", PUBLISHED)
def test_machines_through_the_command(name: str, real_data: Measurements, tmp_path: Path) -> None:
    """The command names what is surely in a machine and nothing else, with the parameters that were published."""
    case = tomllib.loads((real_data() / "cases.toml").read_text())[name]
    effects, parameters, left = PUBLISHED[name]
    answer = asked(name, case, tmp_path, "600s", real_data()).document

    assert answer["missing"] == effects.split()
    assert answer["error"]["after"] < left * answer["error"]["before"]
    for parameter, (value, apart) in parameters.items():
        assert answer["parameters"][parameter][0] == pytest.approx(value, rel=apart)


def damper(folder: Path, name: str) -> Recording:
    """Every eighth sample; the force as the gear's contact counts it, positive when the driven side is ahead."""
    recording = read_recording(folder / f"{name}.csv")
    columns = {key: (-values if key == "force" else values)[::8] for key, values in recording.columns.items()}
    return replace(recording, time=recording.time[::8], columns=columns)


def test_friction_damper_has_a_gap(real_data: Measurements) -> None:
    """A damper driven through a gap, 1 m of radius so that rad are m: from two wrong gaps the same one is found, and a
    recording at half the speed is met better than by a spring without a gap."""
    folder = real_data("friction_backlash_30lb")
    fixed = {"R1": 1.0, "R2": 1.0, "J2": 300.0, "beta": 1e4, "l": 0.1, "k": 2656.0, "b": 0.17, "bias": 0.0}
    held = {key: Parameter(value, fixed=True) for key, value in fixed.items()}
    held["coulomb_friction.omega_0"] = Parameter(5e-3, fixed=True)
    free = {"alpha": Parameter(2e4, high=1e7), "coulomb_friction.tau_c": Parameter(1e4, high=1e5)}
    error = {}
    gaps = []
    for n, d in ((3, 5e-3), (3, 12e-3), (1, 5e-3)):
        values = {**held, **free, "n": Parameter(n, fixed=True), "d": Parameter(d, high=0.05)}
        model = build_model("play", ["coulomb_friction"], values)
        (train,) = experiments(model, [damper(folder, "1Hz_30lb_1in")])
        (test,) = experiments(model, [damper(folder, "0p5Hz_30lb_1in")])
        task = Task(model, (train,), {"force": 500.0}, coarse_substep(model, [train]), 0)
        level = fitted(model, Unknowns.of(model), [segment_of(model, train, task.noise)], task.substep_s)
        whole = segment_of(level.model, test, task.noise)
        error[n, d] = 500 * rms(whole.residual(level.model, whole.start, task.substep_s))
        gaps.append(level.model.parameters["d"].value)

    assert gaps[0] == pytest.approx(8.5e-3, rel=0.1)
    assert gaps[1] == pytest.approx(gaps[0], rel=0.02)
    assert error[3, 5e-3] < 0.30 * 4448.2
    assert error[1, 5e-3] > 1.08 * error[3, 5e-3]
