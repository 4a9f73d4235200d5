"""Effects of the catalogue, tried on a model: rough fits with one more, from several beginnings.  No verdicts here.

Near the noise the score test says where an effect would begin and how large it would be.  Far from it, an effect that
moves the gears moves all impacts, and the play that fitted best without it is the wrong one: effect and play are laid
out together, on short stretches whose start states are found anew for each.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace

import numpy as np

from lostmotion.lab.experiment import Experiment
from lostmotion.lab.grow import Level, fitted
from lostmotion.lab.scoretest import Direction, start_with
from lostmotion.lab.search import Task, best_of, full_fit, refined, started, subset
from lostmotion.lab.seeds import AMPLITUDE, Sizes, seeds, sizes
from lostmotion.lab.stretch import state_scales
from lostmotion.lab.unknowns import Unknowns, free_names
from lostmotion.model import Model
from lostmotion.model.motion import FloatArray

__all__ = ["Trial", "far_trials", "near_trials"]

OFF_THE_GEARS = frozenset(
    (
        "hardening_spring",
        "quadratic_damping",
        "second_mode",
        "gravity_leakage",
        "centripetal_crosstalk",
        "sensor_saturation",
        "clock_skew",
        "bias_drift",
    )
)
PLAY_SHARE = np.geomspace(0.65, 1.45, 8)
MOST_GRIDDED = 12
NEAR = 12
FULL = 4
EXPLAINED = 1.25
"""Times the noise, at which a fit on short stretches leaves nothing to look for."""
KEPT = 2


@dataclass(frozen=True, eq=False)
class Trial:
    """A fit with one more effect."""

    effect: str
    level: Level


def near_trials(
    level: Level, directions: Sequence[Direction], task: Task, pool: Executor, iterations: int = 15
) -> list[Trial]:
    """Fits on the same stretches, each beginning with what the score test asks for; best first."""
    count = len(directions)
    levels = pool.map(_with_direction, directions, [level] * count, [task] * count, [iterations] * count)
    return _ordered([Trial(d.effect, fit) for d, fit in zip(directions, levels, strict=True)])


def far_trials(
    base: Level, directions: Sequence[Direction], effects: Sequence[str], task: Task, pool: Executor
) -> list[Trial]:
    """The best few effects, each fitted on all of the shortest stretches; best first.

    base: the fit without them on the shortest stretches; directions: of its score test.
    """
    near = near_trials(base, directions[:NEAR], task, pool, iterations=6)
    gridded = [] if near and near[0].level.typical < EXPLAINED else _on_the_gears(effects, base)
    size, few = sizes(base.model, base.stretches, task.substep_s), subset(task, longer=1)[::2]
    count = len(gridded)
    far = pool.map(_gridded, gridded, [base] * count, [size] * count, [few] * count, [task] * count)
    both = [*_best_of_each(near)[:FULL], *_best_of_each([t for trials in far for t in trials])[:FULL]]
    levels = pool.map(full_fit, [trial.level.model for trial in both], [task] * len(both))
    fits = [Trial(trial.effect, fit) for trial, fit in zip(both, levels, strict=True)]
    return _best_of_each([*near, *fits])


def _on_the_gears(effects: Sequence[str], base: Level) -> list[str]:
    return [e for e in effects if base.model.base == "play" and e not in OFF_THE_GEARS]


def _best_of_each(trials: Sequence[Trial]) -> list[Trial]:
    """The best trial of each effect, best first."""
    best: dict[str, Trial] = {}
    for trial in _ordered(trials):
        best.setdefault(trial.effect, trial)
    return list(best.values())


def _ordered(trials: Sequence[Trial]) -> list[Trial]:
    return sorted((t for t in trials if np.isfinite(t.level.typical)), key=lambda trial: trial.level.typical)


def _with_direction(direction: Direction, level: Level, task: Task, iterations: int) -> Level:
    """The level's fit with one more effect, of the amplitude that the score test asks for, within what it may be."""
    model, values = direction.model, {}
    for name in AMPLITUDE.get(direction.effect, ()):
        parameter = model.parameters[full := f"{direction.effect}.{name}"]
        faint = parameter.value
        wanted = faint * direction.amplitude
        values[full] = min(max(wanted, parameter.low, faint if parameter.low >= 0 else parameter.low), parameter.high)
    model = model.replace(values)
    stretches = [
        replace(s, start=start_with(s.experiment.model(model), s), scale=_scale(model, s.scale, s.experiment))
        for s in level.stretches
    ]
    return fitted(model, Unknowns.of(model, task.rough), stretches, task.substep_s, iterations=iterations)


def _scale(model: Model, known: FloatArray, experiment: Experiment) -> FloatArray:
    return np.concatenate((known, state_scales(model, experiment)[known.size :]))


def _gridded(effect: str, base: Level, size: Sizes, few: Sequence[Experiment], task: Task) -> list[Trial]:
    """Rough fits with an effect on the gears: sizes and plays around what the file says, not around a wrong fit."""
    found = seeds(base.model.with_effect(effect), effect, size)
    if len(found) > MOST_GRIDDED or "d" not in free_names(task.rough):
        return []
    d, model = task.rough.parameters["d"], task.rough.with_effect(effect)
    plays = [float(np.clip(d.value * share, d.low, d.high)) for share in PLAY_SHARE]
    levels = [started(model.replace({**values, "d": play}), few, task) for values in found for play in plays]
    usable = best_of((level for level in levels if np.isfinite(level.typical)), KEPT)
    return [Trial(effect, refined(level, task)) for level in usable]
