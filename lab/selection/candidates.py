"""Effects of the catalogue, tried on a model: rough fits with one more, from several beginnings.  No verdicts here.

Near the noise the score test says where an effect would begin and how large it would be.  Far from it, an effect that
moves the gears moves all impacts, and the play that fitted best without it is the wrong one: there observer runs, in
which effect and play are searched together, say which effects are worth a fit.  They go through successive halving on
longer and longer segments, on which only the right one stays.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from typing import Protocol, TypeVar

import numpy as np

from lostmotion.lab import policy
from lostmotion.lab.fitting.strategy import doubled, full_fit, nearest_fit, refined, repaired_fit
from lostmotion.lab.observer.filter import can_follow
from lostmotion.lab.observer.global_search import Near, cost_of, shortlist
from lostmotion.lab.selection.nesting import contained, simpler
from lostmotion.lab.selection.score_test import Direction
from lostmotion.lab.selection.validate import LONGER, is_left, trained
from lostmotion.lab.shooting.continuation import Level, fitted
from lostmotion.lab.shooting.initial_state import repaired
from lostmotion.lab.shooting.parameters import Unknowns
from lostmotion.lab.shooting.segment import start_with, state_scales
from lostmotion.lab.shooting.task import Task
from lostmotion.model import Model, catalogue
from lostmotion.model.effects import get_effect

__all__ = [
    "Trial",
    "best_of_each",
    "far_trials",
    "followed_fit",
    "halving_fits",
    "near_trials",
    "next_trials",
    "others",
    "pair_trials",
    "repaired_trial",
]

NEAR_ITERATIONS, REPAIRED, TOGETHER = 6, 6, 2
"""Steps of a first fit, and of one whose missed segments begin anew; fits that run beside each other."""


class _OfEffect(Protocol):
    @property
    def effect(self) -> str: ...


T = TypeVar("T", bound=_OfEffect)


@dataclass(frozen=True, eq=False)
class Trial:
    """A fit with one more effect."""

    effect: str
    level: Level


def best_of_each(ordered: Iterable[T]) -> list[T]:
    """The first one of each effect, in their order."""
    best: dict[str, T] = {}
    for one in ordered:
        best.setdefault(one.effect, one)
    return list(best.values())


def others(model: Model) -> list[str]:
    """The effects of the catalogue that the model may have and has not, nor has as a part of another one."""
    may = (e.id for e in catalogue() if model.base in e.bases and e.id not in model.effects)
    return [effect for effect in may if get_effect(effect).is_searched and not contained(model, effect)]


def near_trials(
    level: Level, directions: Sequence[Direction], task: Task, pool: Executor, iterations: int = 15
) -> list[Trial]:
    """Fits on the same segments, each beginning with what the score test asks for; best first."""
    count = len(directions)
    levels = pool.map(_with_direction, directions, [level] * count, [task] * count, [iterations] * count)
    return _ordered([Trial(d.effect, fit) for d, fit in zip(directions, levels, strict=True)])


def far_trials(
    base: Level, directions: Sequence[Direction], task: Task, horizon_s: float, pool: Executor
) -> tuple[list[Trial], list[Near]]:
    """The best few effects, each fitted on segments of about this length; best first.

    base: the fit without them on the shortest segments; directions: of its score test.  Where the bar was measured and
    more than noise is left by all of these, observer runs say what else is worth a fit; what they come near to is told
    as well.
    """
    observed = can_follow(task.rough, *task.experiments)
    near = near_trials(
        base, directions[: policy.SHORTLISTED if observed else policy.SCREENED], task, pool, NEAR_ITERATIONS
    )
    few = policy.FEWEST if observed and near and near[0].level.typical > policy.FAR else policy.FITTED
    strongest = [trial for trial in near[few:] if trial.effect == directions[0].effect]
    full = _full_fits([(trial.effect, trial.level.model) for trial in (*near[:few], *strongest)], task, pool)
    if not observed:
        return _halving(full, task, horizon_s, pool, base.typical), []
    if full and full[0].level.typical < min(policy.FAR, policy.NEARER * base.typical):
        survivors = _halving(full, task, horizon_s, pool, base.typical)
        if survivors and not is_left(trained(survivors[0].level, task.substep_s)):
            # it may have a parameter too many
            begin = [found] if (found := simpler(survivors[0].level.model, survivors[0].effect)) else []
            return _ordered([*survivors, *halving_fits(begin, task, horizon_s, pool, base.typical)]), []
    near_by = shortlist(base, others(base.model), task, pool)
    full = _ordered([*full, *_full_fits(_nearest(near_by), task, pool)])
    return _halving(full, task, horizon_s, pool, base.typical), best_of_each(near_by)


def next_trials(
    known: Sequence[Model], near: Sequence[Near], task: Task, horizon_s: float, pool: Executor
) -> list[Trial]:
    """Fits with the effects that come next in what observer runs come near to; none where none of them helps more than
    the models that are known already."""
    few = _nearest(near, policy.FITTED)
    full = _full_fits([*few, *(("", model) for model in known)], task, pool) if few else []
    before = next((trial.level.typical for trial in full if not trial.effect), math.inf)
    useful = [trial for trial in full if trial.level.typical < policy.NEARER * before]
    return _halving(useful, task, horizon_s, pool, before) if useful else []


def pair_trials(base: Level, first: Sequence[Near], task: Task, horizon_s: float, pool: Executor) -> list[Trial]:
    """Fits with two more effects at once, named by the second one: those that bring observer runs with one of the first
    ones nearest to the measurement.  None where the first ones bring them hardly nearer: what is missing is another."""
    if not first or first[0].cost > policy.NEARER * cost_of(base, task):
        return []
    pairs = [shortlist(base, others(one.model), task, pool, one) for one in first]
    nearer = [
        pair for one, found in zip(first, pairs, strict=True) for pair in found if pair.cost < policy.NEARER * one.cost
    ]
    return halving_fits(_nearest(sorted(nearer, key=lambda pair: pair.cost)), task, horizon_s, pool, base.typical)


def repaired_trial(effect: str, model: Model, level: Level, task: Task) -> Trial:
    """The fit of a model with an effect that has no states of its own, from a level's starts; those that are missed
    begin anew."""
    return Trial(effect, repaired_fit(model, Unknowns.of(model, task.rough), level.segments, task, policy.HOPELESS))


def followed_fit(near: Near, task: Task) -> Trial:
    """The fit on all short segments that begins where observer runs have come to."""
    return Trial(near.effect, full_fit(near.model, task, policy.HOPELESS))


def _nearest(ordered: Sequence[Near], begin: int = 0) -> list[tuple[str, Model]]:
    """Of the first few effects, or the next ones, those that are not far behind."""
    effects = {near.effect for near in best_of_each(ordered)[begin : begin + policy.FITTED]}
    followed = [
        near for near in ordered if near.effect in effects and near.cost < policy.FIRST_BEHIND * ordered[0].cost
    ]
    return [(near.effect, near.model) for near in followed[: policy.FITTED + 1]]


def halving_fits(
    begin: Sequence[tuple[str, Model]], task: Task, horizon_s: float, pool: Executor, before: float = math.inf
) -> list[Trial]:
    """The models with their effects fitted on all short segments, then survivors up to this length; best first.

    before: the typical error of the short segments without these effects; noise's is one.
    """
    return _halving(_full_fits(begin, task, pool), task, horizon_s, pool, before)


def _full_fits(begin: Sequence[tuple[str, Model]], task: Task, pool: Executor) -> list[Trial]:
    """The models with their effects fitted on all short segments, best first."""
    count = len(begin)
    levels = pool.map(full_fit, [model for _, model in begin], [task] * count, [policy.HOPELESS] * count)
    return _ordered([Trial(effect, level) for (effect, _), level in zip(begin, levels, strict=True)])


def _halving(full: Sequence[Trial], task: Task, horizon_s: float, pool: Executor, before: float) -> list[Trial]:
    each = _settled(best_of_each(full), task, pool)
    if each and each[0].level.typical > max(policy.NEARER * before, policy.FAR):
        return each[: policy.FEWEST]
    if len(each) < 2 or each[0].level.typical < policy.NEARER * each[1].level.typical:
        each[:1] = [_recounted(trial, task, pool, _repaired) for trial in each[:1]]
    survivors = _survivors(each, task, horizon_s, pool)
    return _ordered([_recounted(trial, task, pool, refined) for trial in survivors])


def _settled(each: list[Trial], task: Task, pool: Executor) -> list[Trial]:
    """The trials, the best of those that stay far from the noise also from where observer runs come nearest with their
    effect, again while that helps: they began with the play and the damping of a model without it."""
    for seed in itertools.count(step=TOGETHER):
        if not (each and each[0].level.typical > policy.FAR and can_follow(task.rough, *task.experiments)):
            break
        best = each[0].level.typical
        few = [trial for trial in each[:TOGETHER] if trial.level.typical < policy.FIRST_BEHIND * best]
        few = few if len(few) == TOGETHER else few[:1] * TOGETHER
        models, seeds = [trial.level.model for trial in few], range(seed, seed + TOGETHER)
        fits = pool.map(nearest_fit, models, [task] * TOGETHER, seeds, [policy.HOPELESS] * TOGETHER)
        anew = [Trial(trial.effect, fit) for trial, fit in zip(few, fits, strict=True)]
        each = best_of_each(_ordered([*each, *anew]))
        if not each[0].level.typical < policy.NEARER * best:
            break
    return each


def _survivors(trials: list[Trial], task: Task, horizon_s: float, pool: Executor) -> list[Trial]:
    """The trials on longer and longer segments, those that fall far behind the best left out."""
    behind = policy.FIRST_BEHIND
    while trials and trials[0].level.horizon_s * LONGER < horizon_s:
        running = [t for t in trials if t.level.typical < behind * max(trials[0].level.typical, 1.0)][: policy.FINISHED]
        levels = pool.map(doubled, [t.level for t in running], [task] * len(running), [policy.HOPELESS] * len(running))
        longer = [Trial(t.effect, level) for t, level in zip(running, levels, strict=True) if level is not None]
        if not longer:
            break
        trials, behind = _ordered(longer), policy.BEHIND
    return trials


def _repaired(level: Level, task: Task) -> Level:
    """A few steps from a level's values, twice: what is missed after the first ones begins anew."""
    once = refined(level, task, REPAIRED)
    starts = repaired(once.model, once.segments, task.substep_s, policy.HOPELESS)
    return refined(replace(once, segments=starts), task, REPAIRED)


def _recounted(trial: Trial, task: Task, pool: Executor, fit: Callable[[Level, Task], Level]) -> Trial:
    """The trial with whole numbers (of teeth) nearby tried as well, until none is better."""
    whole = [f"{trial.effect}.{name}" for name, p in trial.level.model.own(trial.effect).items() if p.domain.is_whole]
    best = trial.level
    for name in whole:
        known = {best.model.parameters[name].value}
        while True:
            p = best.model.parameters[name]
            near = {p.value + step for step in (-3, -2, -1, 1, 2, 3) if p.low <= p.value + step <= p.high}
            others = [replace(best, model=best.model.replace({name: count})) for count in sorted(near - known)]
            level = min(pool.map(fit, others, [task] * len(others)), key=lambda level: level.typical, default=best)
            if not level.typical < best.typical:
                break
            best, known = level, known | near
    return Trial(trial.effect, best)


def _ordered(trials: Sequence[Trial]) -> list[Trial]:
    return sorted((t for t in trials if np.isfinite(t.level.typical)), key=lambda trial: trial.level.typical)


def _with_direction(direction: Direction, level: Level, task: Task, iterations: int) -> Level:
    """The level's fit with one more effect, of the amplitude that the score test asks for, within what it may be."""
    model, values = direction.model, {}
    for name in get_effect(direction.effect).amplitudes:
        parameter = model.parameters[full := f"{direction.effect}.{name}"]
        faint = parameter.value
        wanted = faint * direction.amplitude
        values[full] = min(max(wanted, parameter.low, faint if parameter.low >= 0 else parameter.low), parameter.high)
    model = model.replace(values)
    segments = [
        replace(
            segment,
            start=start_with(segment.experiment.model(model), segment, level.model.state_names),
            scale=state_scales(model, segment.experiment),
        )
        for segment in level.segments
    ]
    return fitted(model, Unknowns.of(model, task.rough), segments, task.substep_s, iterations=iterations)
