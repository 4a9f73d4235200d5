"""The base of a fit: a first rough fit that lies in the right valley, then the growing horizon.  No verdicts here.

The oscillator's frequency comes from the spectrum, the play from a grid of values: with another play every impact
comes at another time, and no gradient leads from one to the other.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass

import numpy as np

from lostmotion.lab.experiment import Experiment
from lostmotion.lab.grow import Level, first_level, fitted, merged, missing, residuals, tiles
from lostmotion.lab.rough import from_spectra, usual_torque
from lostmotion.lab.start import find_start, repaired, ringing_hz, stretch_of
from lostmotion.lab.unknowns import Unknowns, free_names
from lostmotion.model import Model
from lostmotion.model.motion import FloatArray

__all__ = ["Task", "best_of", "coarse_substep", "first_fit", "grown", "refined", "seeded", "started", "subset"]

PLAY_SHARE = np.geomspace(0.62, 1.5, 11)
DAMPING_SHARE = (1.0, 0.4)
FREQUENCY_SHARE = 0.12
SEARCH_STEPS = {"play": 4.0, "oscillator": 2.0, "joint": 4.0, "servo": 2.0}  # times the model's own choice of step
FRICTION_SHARE = 0.2
SUBSET = 10
LOST = 4.0
"""Times the error of the shortest stretches, from which longer ones have lost the motion."""
CONVERGED = 0.3
"""What half the step may change, in units of the noise."""
NUDGE = 1e-4
NUDGED = 4.0
"""What this share of the start state's scale may change, in units of the noise, before a stretch counts as chaotic."""
SCANNED = 4
KEPT = 2


@dataclass(frozen=True, eq=False)
class Task:
    """What is fitted: the model as its file gave it, experiments with the noise of each column, the solver's step."""

    rough: Model
    experiments: tuple[Experiment, ...]
    noise: dict[str, float]
    substep_s: float
    halvings: int

    @classmethod
    def of(
        cls, model: Model, experiments: Sequence[Experiment], noise: dict[str, float], substep_s: float | None = None
    ) -> Task:
        """For these experiments, the step chosen for a search unless given."""
        halvings = max(first_level(model.base, experiment) for experiment in experiments)
        rough = from_spectra(model, experiments)
        step = substep_s or coarse_substep(_rubbing(rough, experiments), experiments)
        return cls(rough, tuple(experiments), noise, step, halvings)


def _rubbing(model: Model, experiments: Sequence[Experiment]) -> Model:
    """A joint or servo with friction: what the search will add is stiffer than what is there."""
    if model.base not in ("joint", "servo") or "coulomb_friction" in model.effects:
        return model
    friction = FRICTION_SHARE * max(usual_torque(model, experiment) for experiment in experiments)
    return model.with_effect("coulomb_friction").replace({"coulomb_friction.tau_c": friction})


def coarse_substep(model: Model, experiments: Sequence[Experiment], factor: float | None = None) -> float:
    """An integration step for all fits of this model: its own choice on each experiment, times ``factor``.

    Without a factor, one that is good enough for a search.
    """
    own = [e.model(model).simulate(e.drive, e.between(e.time[0], e.time[0] + 1.0).time).substep_s for e in experiments]
    return min(own) * (factor or SEARCH_STEPS.get(model.base, 1.0))


def seeded(model: Model, experiments: Sequence[Experiment]) -> Model:
    """The model with its frequency from the spectrum, where a bar is measured and its stiffness is free; with more
    from the spectra of input and output, where both were recorded."""
    known = from_spectra(model, experiments)
    if known is not model or model.base not in ("play", "oscillator") or "k" not in free_names(model):
        return known
    k, m = model.parameters["k"], model.parameters["m"].value
    rough = math.sqrt(k.value / m) / (2 * math.pi)
    lines = [ringing_hz(e, rough * (1 - FREQUENCY_SHARE), rough * (1 + FREQUENCY_SHARE)) for e in experiments]
    stiffness = m * (2 * math.pi * float(np.median(lines))) ** 2
    return model.replace({"k": min(max(stiffness, k.low), k.high)})


def subset(task: Task, longer: int = 0) -> list[Experiment]:
    """A few stretches that stand for all, spread over the experiments; doubled in length ``longer`` times."""
    halvings = max(task.halvings - longer, 0)
    every = [tile for experiment in task.experiments for tile in tiles(experiment, halvings)]
    return [every[i] for i in np.unique(np.linspace(0, len(every) - 1, min(SUBSET, len(every))).astype(int))]


def started(model: Model, stretches: Iterable[Experiment], task: Task, known: Level | None = None) -> Level:
    """The stretches with their start states found, nothing else fitted.

    known: a fit of the same stretches without the last effects, whose start states are tried as well.
    """
    also = {(s.experiment.name, float(s.experiment.time[0])): s.start for s in known.stretches} if known else {}
    found = []
    for stretch in (stretch_of(model, s, task.noise) for s in stretches):
        old = also.get((stretch.experiment.name, float(stretch.experiment.time[0])))
        states = [] if old is None else [np.concatenate((old, stretch.start[old.size :]))]
        found.append(find_start(model, stretch, task.substep_s, states))
    return fitted(model, Unknowns.of(model, task.rough), found, task.substep_s, iterations=0)


def first_fit(model: Model, task: Task, pool: Executor) -> Level:
    """The best fit on the shortest stretches, from a grid of plays and dampings on gears."""
    grid = _grid(seeded(model, task.experiments))
    few = subset(task)
    scanned = best_of(pool.map(started, grid, [few] * len(grid), [task] * len(grid)), SCANNED)
    rough = best_of(pool.map(refined, scanned, [task] * len(scanned)), KEPT)
    return best_of(pool.map(full_fit, [level.model for level in rough], [task] * len(rough)), 1)[0]


def refined(level: Level, task: Task, iterations: int = 8) -> Level:
    """A few steps from a level's values."""
    return fitted(level.model, level.unknowns, level.stretches, task.substep_s, iterations=iterations)


def best_of(levels: Iterable[Level], count: int) -> list[Level]:
    """Those with the smallest typical error, best first."""
    return sorted(levels, key=lambda level: level.typical)[:count]


def full_fit(model: Model, task: Task) -> Level:
    """A fit on all of the shortest stretches, those that were missed begun anew."""
    every = [tile for experiment in task.experiments for tile in tiles(experiment, task.halvings)]
    level = started(model, every, task)
    level = fitted(model, level.unknowns, level.stretches, task.substep_s)
    again = repaired(level.model, level.stretches, task.substep_s) if model.base == "play" else level.stretches
    return fitted(level.model, level.unknowns, again, task.substep_s)


def grown(level: Level, task: Task, down_to: int = 0) -> Level:
    """The fit on stretches twice as long, and so on; the longest of these levels that can be trusted.

    Trusted: hardly a stretch is missed, and half the integration step changes nothing.  In a chaotic record neither
    holds for long stretches.
    """
    found = [level]
    if level.model.base == "joint":  # it drifts away
        return level
    for halvings in range(task.halvings - 1, down_to - 1, -1):
        stretches = merged(level.stretches, task.experiments, halvings)
        if level.model.base == "play":
            stretches = repaired(level.model, stretches, task.substep_s)
        level = fitted(level.model, level.unknowns, stretches, task.substep_s)
        found.append(level)
        if level.typical > LOST * max(found[0].typical, 1.0):
            break
    doubts = [_doubt(level, task) for level in found]
    return min(zip(doubts, found, strict=True), key=lambda pair: (pair[0], -pair[1].horizon_s))[1]


def _doubt(level: Level, task: Task) -> float:
    """Share of the stretches that are missed, not converged or chaotic; up to a tenth of them count as none."""
    missed = missing(level.model, level.stretches, task.substep_s)
    fine, finer = (coarse_substep(level.model, task.experiments, factor) for factor in (1.0, 0.5))
    here = residuals(level.model, level.stretches, fine)
    halved = residuals(level.model, level.stretches, finer)
    nudged = [stretch.starting(stretch.start + NUDGE * stretch.scale) for stretch in level.stretches]
    apart = residuals(level.model, nudged, fine)
    moved = [_rms(a - b) > CONVERGED for a, b in zip(here, halved, strict=True)]
    chaotic = [_rms(a - b) > NUDGED for a, b in zip(here, apart, strict=True)]
    share = float(np.mean(missed | np.array(moved) | np.array(chaotic)))
    return share if share > 0.1 else 0.0


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _grid(model: Model) -> list[Model]:
    if model.base != "play":
        return [model]
    free = free_names(model)
    plays = PLAY_SHARE if "d" in free else (1.0,)
    dampings = DAMPING_SHARE if "alpha" in free else (1.0,)
    d, alpha = model.parameters["d"], model.parameters["alpha"]
    values = {(min(max(d.value * a, d.low), d.high), min(max(alpha.value * b, alpha.low), alpha.high))
              for a in plays for b in dampings}  # fmt: skip
    return [model.replace({"d": value, "alpha": damping}) for value, damping in sorted(values)]
