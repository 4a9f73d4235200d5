"""What all fits of a search by multiple shooting share: model, experiments, noise and integration step.  Nothing is
fitted here."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from lostmotion.lab.data.experiment import Experiment
from lostmotion.lab.data.frequency_response import from_spectra
from lostmotion.lab.data.series import rms
from lostmotion.lab.shooting.continuation import first_level, tiles
from lostmotion.model import Model, ModelError

__all__ = ["Task", "coarse_substep", "dithered", "fine_substep"]

SEARCH_STEPS = {"play": 8.0, "oscillator": 2.0, "joint": 4.0, "servo": 2.0}
"""By base, the integration step of a search, in steps that the model chooses."""
LONGEST_STEP_S = {"play": 5e-4}
"""By base, the longest integration step of a search [s]."""
LOOKED_AT_S, LOOKED_AT = 1.0, 100
"""Length [s], and least number of samples, of the motion from which the integration step is chosen."""
DITHER = 5.0
"""Least ratio of the noise to the error of integration, which is then 4 % of the variance of the noise.  With 3, 5 and
10 nothing is missing from the models of three simulated recordings, with errors of 0.99 to 1.06 times the noise."""


@dataclass(frozen=True, eq=False)
class Task:
    """The task of a fit.

    rough: the model of the file, with linear parameters from the spectra; experiments; noise: root mean square of the
    noise of each column; substep_s: integration step of a search [s]; halvings: how often the experiments are halved
    for the shortest segments; longest_s: length of the longest segments that the input allows [s];
    input_share: share of the squared noise of the main column that the input causes.
    """

    rough: Model
    experiments: tuple[Experiment, ...]
    noise: dict[str, float]
    substep_s: float
    halvings: int
    longest_s: float = math.inf
    input_share: float = 0.0

    @property
    def tiles(self) -> list[Experiment]:
        """The experiments in segments of the shortest length."""
        return [tile for experiment in self.experiments for tile in tiles(experiment, self.halvings)]

    def added(self, model: Model) -> tuple[str, ...]:
        """The effects of a model that the model of the file does not have, in order."""
        return tuple(effect for effect in model.effects if effect not in self.rough.effects)

    @classmethod
    def of(cls, model: Model, experiments: Sequence[Experiment], noise: dict[str, float]) -> Task:
        """The task for a model and experiments."""
        halvings = max(first_level(model.base, experiment) for experiment in experiments)
        rough = from_spectra(model, experiments)
        step = coarse_substep(rough, experiments)
        return cls(rough, tuple(experiments), noise, step, halvings)


def fine_substep(model: Model, experiments: Sequence[Experiment]) -> float:
    """The integration step that a model chooses [s], the smallest of all experiments.  Raises ModelError where it
    cannot be simulated."""
    return min(e.model(model).simulate(e.drive, _beginning(e).time).substep_s for e in experiments)


def coarse_substep(model: Model, experiments: Sequence[Experiment]) -> float:
    """An integration step that is short enough for a search [s], see ``SEARCH_STEPS``.  Raises ModelError where the
    model cannot be simulated."""
    step = SEARCH_STEPS.get(model.base, 1.0) * fine_substep(model, experiments)
    return min(step, LONGEST_STEP_S.get(model.base, math.inf))


def dithered(
    model: Model, experiments: Sequence[Experiment], noise: Mapping[str, float], input_error: Mapping[str, float] = {}
) -> tuple[list[Experiment], dict[str, float]]:
    """The experiments, and the noise of their columns, with white noise added to columns whose noise is below
    ``DITHER`` times the error of integration of a search, or times that of the input.

    The error of integration depends on the motion, as the error of a model that lacks an effect does.  Of gears
    simulated at 1 kHz the force was integrated to 2e-4 of its size, 16 times the noise found in it, and the very model
    that had made it was refused.
    """
    error = _step_error(model, experiments[0], coarse_substep(model, experiments))
    least = {
        name: max(deviation, DITHER * max(error.get(name, 0.0), input_error.get(name, 0.0)))
        for name, deviation in noise.items()
    }
    rng, changed = np.random.default_rng(0), []
    for experiment in experiments:
        measured = {
            name: values + math.sqrt(least[name] ** 2 - noise[name] ** 2) * rng.standard_normal(values.size)
            for name, values in experiment.measured.items()
        }
        changed.append(replace(experiment, measured=measured))
    return changed, least


def _step_error(model: Model, experiment: Experiment, substep_s: float) -> dict[str, float]:
    """The root mean square error of integration with a step in each measured column: the median over the shortest
    segments."""
    own, first = experiment.model(model), _beginning(experiment)
    exact = own.simulate(first.drive, first.time)
    errors: dict[str, list[float]] = {name: [] for name in first.measured}
    for tile in tiles(first, first_level(model.base, first)):
        part = slice(at := int(np.searchsorted(first.time, tile.time[0])), at + tile.time.size)
        with suppress(ModelError):  # it diverges
            coarse = own.simulate(first.drive, tile.time, exact.states[at], substep_s=substep_s)
            for name, found in errors.items():
                found.append(rms(coarse[name] - exact[name][part]))
    return {name: float(np.median(found)) for name, found in errors.items() if found}


def _beginning(experiment: Experiment) -> Experiment:
    """The first second of an experiment, or the first samples of a slow one."""
    length = max(LOOKED_AT_S, LOOKED_AT / experiment.rate_hz)
    return experiment.between(experiment.time[0], experiment.time[0] + length)
