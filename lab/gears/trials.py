"""Candidate effects for gears: rough fits of a model with one more effect, from several initial values.  No selection
here.

The score test gives initial values of an effect.  Far from the noise, an effect on the gears shifts all impacts, and
the play fitted without it is wrong: there a search with observers, over effect and play together, selects the effects
to fit.  Successive halving on longer and longer segments then eliminates wrong ones.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from lostmotion.lab import policy
from lostmotion.lab.fitting.strategy import doubled, full_fit, refined, repaired_fit
from lostmotion.lab.gears.score_test import Direction
from lostmotion.lab.gears.unseen import LONGER
from lostmotion.lab.observer.global_search import search_effects
from lostmotion.lab.selection.nesting import in_place, others
from lostmotion.lab.shooting.continuation import Level, fitted
from lostmotion.lab.shooting.initial_state import repaired
from lostmotion.lab.shooting.parameters import Unknowns
from lostmotion.lab.shooting.segment import Segment, start_with, state_scales
from lostmotion.lab.shooting.task import Task
from lostmotion.model import Model
from lostmotion.model.effects import get_effect

__all__ = [
    "FEW_STEPS",
    "Trial",
    "full_fits",
    "full_trials",
    "halving",
    "near_trials",
    "observer_trials",
    "repaired_trial",
    "with_other_delays",
]

FEW_STEPS = 6
"""Steps of a fit that compares effects, or numbers of teeth."""


@dataclass(frozen=True, eq=False)
class Trial:
    """A fit with one more effect; short: the one on the shortest segments that it grew from, where there is one."""

    effect: str
    level: Level
    short: Level | None = None


def near_trials(
    level: Level, directions: Sequence[Direction], task: Task, pool: Executor, iterations: int = 15
) -> list[Trial]:
    """Fits on the same segments, each beginning at the amplitude of the score test; best first."""
    levels = pool.map(partial(_with_direction, level=level, task=task, iterations=iterations), directions)
    return _ordered([Trial(d.effect, fit) for d, fit in zip(directions, levels, strict=True)])


def full_trials(near: Sequence[Trial], effect: str, task: Task, pool: Executor) -> list[Trial]:
    """Fits on all short segments that begin at those of ``near_trials``: at the one with the least error, at that with
    this effect, which has the largest statistic, and at those with a simpler law of which one of them is a more general
    one; best first."""
    asked = {effect, *(trial.effect for trial in near[:1])}
    asked |= {part.effect for name in asked if (part := get_effect(name).simpler)}
    return full_fits([(trial.effect, trial.level.model) for trial in near if trial.effect in asked], task, pool)


def observer_trials(base: Level, effects: Sequence[str], task: Task, pool: Executor) -> list[Trial]:
    """Fits on all short segments with those of the effects of least prediction error of observers; best first."""
    return full_fits([(one.effect, one.model) for one in search_effects(base, effects, task, pool)], task, pool)


def repaired_trial(effect: str, model: Model, level: Level, task: Task) -> Trial:
    """The fit of a model with other effects from a level's initial states; those of missed segments are searched for
    again."""
    return Trial(
        effect, repaired_fit(model, Unknowns.of(model, task.rough), _segments(model, level), task, policy.LOST_SHARE)
    )


def full_fits(begin: Sequence[tuple[str, Model]], task: Task, pool: Executor) -> list[Trial]:
    """The models with their effects fitted on all short segments, best first."""
    levels = pool.map(partial(full_fit, task=task, max_missed=policy.LOST_SHARE), [model for _, model in begin])
    return _ordered([Trial(effect, level, level) for (effect, _), level in zip(begin, levels, strict=True)])


def halving(full: Sequence[Trial], task: Task, horizon_s: float, pool: Executor) -> list[Trial]:
    """The trials on longer and longer segments, up to this length, without those that fall behind the best."""
    trials = _ordered(list({trial.effect: trial for trial in reversed(_ordered(full))}.values()))
    trials[:1] = [_recounted(trial, task, pool) for trial in trials[:1]]
    while trials and trials[0].level.horizon_s * LONGER < horizon_s:
        limit = policy.BEHIND * max(trials[0].level.typical, 1.0)
        running = [trial for trial in trials if trial.level.typical < limit]
        longer_fit = partial(doubled, task=task, max_missed=policy.LOST_SHARE)
        levels = pool.map(longer_fit, [trial.level for trial in running])
        longer = [replace(t, level=level) for t, level in zip(running, levels, strict=True) if level is not None]
        if not longer:
            break
        trials = _ordered(longer)
    return trials


def with_other_delays(model: Model, task: Task) -> Iterator[tuple[str, Model]]:
    """The alternatives to each effect that delays, with the same delay: a delay, a lag of the actuator and a lag of the
    sensor are equal to first order in their time."""
    possible = [effect for effect in others(model) if get_effect(effect).delays_by]
    for old in task.added(model):
        if own := get_effect(old).delays_by:
            delay = model.parameters[f"{old}.{own}"].value
            for new in possible:
                yield new, in_place(model, old, new).replace({f"{new}.{get_effect(new).delays_by}": delay})


def _recounted(trial: Trial, task: Task, pool: Executor) -> Trial:
    """The trial with whole numbers (of teeth) nearby tried as well, until none is better."""
    whole = [f"{trial.effect}.{name}" for name, p in trial.level.model.own(trial.effect).items() if p.domain.is_whole]
    best = trial.level
    for name in whole:
        known = {best.model.parameters[name].value}
        while True:
            p = best.model.parameters[name]
            near = {p.value + step for step in (-3, -2, -1, 1, 2, 3) if p.low <= p.value + step <= p.high}
            others = [replace(best, model=best.model.replace({name: count})) for count in sorted(near - known)]
            level = min(pool.map(partial(_repaired, task=task), others), key=lambda level: level.typical, default=best)
            if not level.typical < best.typical:
                break
            best, known = level, known | near
    return Trial(trial.effect, best, best)


def _repaired(level: Level, task: Task) -> Level:
    """A few steps from a level's values, twice; in between, initial states of missed segments are searched for
    again."""
    once = refined(level, task, FEW_STEPS)
    starts = repaired(once.model, once.segments, task.substep_s, policy.LOST_SHARE)
    return refined(replace(once, segments=starts), task, FEW_STEPS)


def _ordered(trials: Sequence[Trial]) -> list[Trial]:
    return sorted((t for t in trials if np.isfinite(t.level.typical)), key=lambda trial: trial.level.typical)


def _with_direction(direction: Direction, level: Level, task: Task, iterations: int) -> Level:
    """The level's fit with one more effect, with the amplitude of the score test, within its bounds."""
    model, values = direction.model, {}
    for name in get_effect(direction.effect).amplitudes:
        parameter = model.parameters[full := f"{direction.effect}.{name}"]
        faint = parameter.value
        wanted = faint * direction.amplitude
        values[full] = min(max(wanted, parameter.low, faint if parameter.low >= 0 else parameter.low), parameter.high)
    model = model.replace(values)
    unknowns = Unknowns.of(model, task.rough)
    return fitted(model, unknowns, _segments(model, level), task.substep_s, iterations=iterations)


def _segments(model: Model, level: Level) -> list[Segment]:
    """A level's segments for a model with other effects."""
    return [
        replace(
            segment,
            start=start_with(segment.experiment.model(model), segment, level.model.state_names),
            scale=state_scales(model, segment.experiment),
        )
        for segment in level.segments
    ]
