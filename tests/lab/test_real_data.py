"""Measurements made by others: the lab finds the effects that are known to be in them, at the error that is known.

``bench.real`` asks for all of them; here are those that are answered in seconds, and two that are fitted by hand: what
the command does not print is their error in the figures that were published.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from bench.real import asked

from lostmotion.drivers.recording import Recording, read_recording
from lostmotion.lab.data.experiment import Experiment, experiments
from lostmotion.lab.data.noise import noise_of
from lostmotion.lab.fitting.strategy import full_fit, seeded
from lostmotion.lab.shooting.continuation import Level, fitted
from lostmotion.lab.shooting.initial_guess import initial_guesses, scales_of
from lostmotion.lab.shooting.initial_state import find_start, segment_of
from lostmotion.lab.shooting.parameters import Unknowns
from lostmotion.lab.shooting.task import Task, coarse_substep
from lostmotion.model import Model, Parameter, build_model
from lostmotion.model.motion import FloatArray
from tests.conftest import Measurements

pytestmark = pytest.mark.slow


def loaded(folder: Path, model: Model, *names: str) -> tuple[Experiment, ...]:
    return experiments(model, [read_recording(folder / f"{name}.csv") for name in names])


def part(experiment: Experiment, share: float) -> Experiment:
    begin = float(experiment.time[0])
    return experiment.between(begin, begin + share * experiment.duration)


def with_each(level: Level, start: Model, effects: Sequence[str], task: Task, most: int = 2) -> dict[str, Level]:
    """The best fit with one more of these effects, from the first few seeds of each.

    start: the other parameters; a fit without the effect may have bent them too far.
    """
    size = scales_of(level.model, level.segments, task.substep_s)
    found = {}
    for effect in effects:
        model = start.with_effect(effect)
        fits = [full_fit(model.replace(values), task) for values in initial_guesses(model, effect, size)[:most]]
        found[effect] = min(fits, key=lambda fit: fit.rms)
    return found


def best(levels: Mapping[str, Level]) -> str:
    return min(levels, key=lambda effect: levels[effect].rms)


def unseen(model: Model, experiment: Experiment, task: Task) -> FloatArray:
    """Measured minus modelled over a whole recording that no fit has seen, its start state alone adapted."""
    segment = find_start(model, segment_of(model, experiment, task.noise), task.substep_s)
    (column,) = experiment.measured
    return segment.residual(experiment.model(model), segment.start, task.substep_s) * task.noise[column]


def rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def test_silverbox_is_a_hardening_spring(real_data: Measurements) -> None:
    """From a multisine: the spring hardens, and the arrow's error falls from 15 mV to below 1 mV."""
    model = build_model("oscillator")
    train = [part(e, 0.25) for e in loaded(real_data("silverbox"), model, "multisine_1")]
    (arrow,) = loaded(real_data("silverbox"), model, "arrow_test")
    task = Task.of(model, train, noise_of(train))
    linear = full_fit(seeded(model, train), task)
    fits = with_each(linear, linear.model, ["hardening_spring", "quadratic_damping"], task)

    assert 13e-3 < rms(unseen(linear.model, arrow, task)) < 17e-3
    assert best(fits) == "hardening_spring"
    assert fits["hardening_spring"].rms < 0.2 * fits["quadratic_damping"].rms
    assert rms(unseen(fits["hardening_spring"].model, arrow, task)) < 0.7e-3


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
