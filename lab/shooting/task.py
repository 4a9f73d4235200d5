"""The task of a fit: model, experiments, noise and integration step.  Nothing is fitted here."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from lostmotion.lab.data.experiment import Experiment
from lostmotion.lab.data.frequency_response import from_spectra, usual_torque
from lostmotion.lab.shooting.continuation import first_level
from lostmotion.model import Model, ModelError
from lostmotion.model.motion import FloatArray

__all__ = ["Task", "coarse_substep", "dithered", "with_friction"]

SEARCH_STEPS = {"play": 8.0, "oscillator": 2.0, "joint": 4.0, "servo": 2.0}  # times the model's own choice of step
LONGEST_STEP_S = {"play": 5e-4}
FRICTION_SHARE = 0.2
LOOKED_AT_S, LOOKED_AT = 1.0, 100
"""Seconds, and least number of samples, of the motion from which the integration step follows."""
LEAST = 8
"""Samples of the shortest segment in which the error of a step is measured."""
DITHER = 5.0
"""Least noise, in errors of the step: these are then 4 % of its variance."""


@dataclass(frozen=True, eq=False)
class Task:
    """The task of a fit: the model of the file, experiments with the noise of each column, the solver's step."""

    rough: Model
    experiments: tuple[Experiment, ...]
    noise: dict[str, float]
    substep_s: float
    halvings: int

    def added(self, model: Model) -> tuple[str, ...]:
        """The effects of a model that the file's lacks, in order."""
        return tuple(effect for effect in model.effects if effect not in self.rough.effects)

    @classmethod
    def of(cls, model: Model, experiments: Sequence[Experiment], noise: dict[str, float]) -> Task:
        """For these experiments, with the step of a search."""
        halvings = max(first_level(model.base, experiment) for experiment in experiments)
        rough = from_spectra(model, experiments)
        step = coarse_substep(with_friction(rough, experiments), experiments)
        return cls(rough, tuple(experiments), noise, step, halvings)


def with_friction(model: Model, experiments: Sequence[Experiment]) -> Model:
    """A joint or servo with friction added: candidates of the search are stiffer than the model."""
    if model.base not in ("joint", "servo") or "coulomb_friction" in model.effects:
        return model
    friction = FRICTION_SHARE * max(usual_torque(model, experiment) for experiment in experiments)
    return model.with_effect("coulomb_friction").replace({"coulomb_friction.tau_c": friction})


def coarse_substep(model: Model, experiments: Sequence[Experiment], factor: float | None = None) -> float:
    """An integration step for all fits of this model: its own choice on each experiment, times ``factor``.

    Without a factor, one that is good enough for a search.
    """
    own = [e.model(model).simulate(e.drive, _beginning(e)).substep_s for e in experiments]
    if factor:
        return min(own) * factor
    return min(min(own) * SEARCH_STEPS.get(model.base, 1.0), LONGEST_STEP_S.get(model.base, math.inf))


def dithered(
    model: Model, experiments: Sequence[Experiment], noise: Mapping[str, float]
) -> tuple[list[Experiment], dict[str, float]]:
    """The experiments and the noise of their columns, with white noise added to those that are finer than the error of
    a search's integration step.

    That error depends on the motion, as what an effect leaves does.  Of gears simulated at 1 kHz the force was
    integrated to 2e-4 of its size, 16 times the noise found in it, and the very model that had made it was refused.
    """
    halvings = max(first_level(model.base, experiment) for experiment in experiments)
    error = _step_error(model, experiments[0], coarse_substep(model, experiments), halvings)
    least = {name: max(deviation, DITHER * error.get(name, 0.0)) for name, deviation in noise.items()}
    rng, changed = np.random.default_rng(0), []
    for experiment in experiments:
        measured = {
            name: values + math.sqrt(least[name] ** 2 - noise[name] ** 2) * rng.standard_normal(values.size)
            for name, values in experiment.measured.items()
        }
        changed.append(replace(experiment, measured=measured))
    return changed, least


def _step_error(model: Model, experiment: Experiment, substep_s: float, halvings: int) -> dict[str, float]:
    """Root mean square error that this step of the integration makes in each measured column, of the median segment."""
    own, times = experiment.model(model), _beginning(experiment)
    exact = own.simulate(experiment.drive, times)
    count = max(experiment.time.size >> halvings, LEAST)
    errors: dict[str, list[float]] = {name: [] for name in experiment.measured}
    for k in range(0, max(times.size - count, 1), count):
        part = slice(k, k + count)
        try:
            coarse = own.simulate(experiment.drive, times[part], exact.states[k], substep_s=substep_s)
        except ModelError:  # it diverges
            continue
        for name, found in errors.items():
            found.append(float(np.sqrt(np.mean((coarse[name] - exact[name][part]) ** 2))))
    return {name: float(np.median(found)) for name, found in errors.items() if found}


def _beginning(experiment: Experiment) -> FloatArray:
    """The times of the first second, or of the first samples of a slow recording."""
    length = max(LOOKED_AT_S, LOOKED_AT / experiment.rate_hz)
    return experiment.between(experiment.time[0], experiment.time[0] + length).time
