"""One step of the search: effects tried on a fit, how they do on unseen data, whether the best of them is missing.

What becomes of many steps is forward.py's.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from lostmotion.lab import policy
from lostmotion.lab.data.clipping import RANGE, at_its_rail
from lostmotion.lab.deadline import is_over
from lostmotion.lab.observer.global_search import Near, cost_of
from lostmotion.lab.selection.candidates import (
    Trial,
    best_of_each,
    far_trials,
    followed_fit,
    near_trials,
    next_trials,
    others,
    pair_trials,
    repaired_trial,
)
from lostmotion.lab.selection.score_test import Direction, Scores, score_test
from lostmotion.lab.selection.validate import LONGER, Judged, Unseen, misfits, trained
from lostmotion.lab.shooting.continuation import Level
from lostmotion.lab.shooting.task import Task

__all__ = ["Step", "Tried", "further", "on_unseen", "promising", "searched", "together", "with_first"]


@dataclass(frozen=True, eq=False)
class Tried:
    """A fit with one more effect, on unseen data; misfit: to the data that decided (see heldout.misfits)."""

    effect: str
    level: Level
    judged: Judged
    misfit: float = math.nan

    @property
    def criterion(self) -> float:
        """Schwarz's on unseen data, errors within 3 % of each other counting as equal: then fewer parameters, whole
        numbers that are searched among them."""
        parameters = sum(not p.fixed or p.domain.is_whole for p in self.level.model.parameters.values())
        return round(self.misfit / policy.ALIKE) + 0.01 * parameters * math.log(self.judged.count)


@dataclass(frozen=True, eq=False)
class Step:
    """A fit without, and those with, one more effect, best first; scores of the fit without.

    near: what observer runs come near to; accepted: the first one's effect is missing; trusted: as the first of two, as
    it explains too little alone; unvalidated: the unseen data are free of it, the training data said so.
    """

    scores: Scores
    tried: tuple[Tried, ...] = ()
    near: tuple[Near, ...] = ()
    accepted: bool = False
    trusted: bool = False
    unvalidated: bool = False

    @property
    def equals(self) -> list[Tried]:
        """The effect that was accepted, and what explains the data that decided as well within ALIKE."""
        if not self.accepted or self.trusted:
            return []
        return [one for one in self.tried if one.misfit < self.tried[0].misfit + policy.ALIKE]

    @property
    def ahead(self) -> Near | None:
        """What brings observer runs far nearer than all others, if anything."""
        if len(self.near) < 2 or self.near[0].cost > policy.NEARER * self.near[1].cost:
            return None
        return self.near[0]

    @property
    def is_full(self) -> bool:
        """Whether the data of the fit hold far more than noise of what the score test asks for."""
        return any(d.statistic > policy.FULL * self.scores.limit for d in self.scores.directions)


def searched(level: Level, short: Level, now: Judged, unseen: Unseen, rng: np.random.Generator) -> Step:
    """One more effect, if there is evidence for one: near the noise, of those that the score test asks for; far from
    it, also of what observer runs come near to."""
    task, pool = unseen.task, unseen.pool
    effects = others(level.model)
    scores = score_test(level, effects, task.substep_s, pool, rng)
    if not scores.directions:
        return Step(scores)
    if not unseen.is_far(max(now.error, level.typical)):
        return _near_step(level, scores, now, unseen)
    first = score_test(short, effects, task.substep_s, pool, rng) if short is not level else scores
    trials, near_by = far_trials(short, _strongest(first, scores), task, unseen.horizon_s, pool)
    return replace(_ranked(scores, on_unseen(trials, now, unseen), now, unseen), near=tuple(near_by))


def _near_step(level: Level, scores: Scores, now: Judged, unseen: Unseen) -> Step:
    """The effects that the score test asks for, and the end of the sensor's range where readings stop at it: segments
    that reach it are missed, and the test does not see them."""
    task = unseen.task
    asked = [d for d in scores.directions[: policy.SHORTLISTED] if d.statistic > scores.limit]
    trials = near_trials(level, asked, task, unseen.pool)
    railed = at_its_rail(level.model, task.experiments) if RANGE in others(level.model) else None
    if railed:
        trials.append(repaired_trial(RANGE, railed, level, task))
    if not trials:
        return Step(scores)
    step = _ranked(scores, on_unseen(trials, now, unseen), now, unseen)
    if step.accepted:
        return step
    return _told_by_training(step, level, now, task, [RANGE] if railed else []) or step


def with_first(step: Step, effect: str, level: Level, unseen: Unseen) -> Step:
    """The step with another fit in the place of its first one."""
    first = step.tried[0]
    (found,) = on_unseen([Trial(effect, level)], first.judged, unseen)
    before, after = misfits([first.judged, found.judged]).tolist()
    found = replace(found, misfit=first.misfit + after - before)
    return replace(step, tried=(found, *(one for one in step.tried[1:] if one.effect != effect)))


def further(step: Step, short: Level, now: Judged, unseen: Unseen) -> Step:
    """The step, or that with the effects which bring observer runs next nearest, if one of them is missing."""
    best = sorted((one.level for one in step.tried), key=lambda level: level.typical)[:1]
    known = [level.model for level in (short, *best)]
    trials = next_trials(known, step.near, unseen.task, unseen.horizon_s, unseen.pool)
    if not trials:
        return step
    found = _ranked(step.scores, [*on_unseen(trials, now, unseen), *step.tried], now, unseen)
    return replace(found, near=step.near) if found.accepted else step


def together(step: Step, short: Level, now: Judged, unseen: Unseen) -> list[Step]:
    """Two steps at once, where each effect alone moves the impacts too wrongly to help; none where no pair does, or
    where one effect has been found already."""
    if unseen.task.added(short.model):
        return []
    first = [step.ahead] if step.ahead else step.near[: policy.FEWEST]
    trials = pair_trials(short, first, unseen.task, unseen.horizon_s, unseen.pool)
    second = _ranked(step.scores, on_unseen(trials, now, unseen), now, unseen)
    if not second.accepted:
        return []
    pair = second.tried[0]
    (effect,) = (effect for effect in unseen.task.added(pair.level.model) if effect != pair.effect)
    alone = next((one for one in step.tried if one.effect == effect), Tried(effect, short, now))
    return [replace(step, tried=_first(alone, step.tried), accepted=True, trusted=True), second]


def promising(step: Step, short: Level, now: Judged, unseen: Unseen) -> Step | None:
    """The step with an effect put first that explains too little alone, but more than all others: of the training data,
    or of what keeps observer runs from following the measurement."""
    if short.model.base != "play" or not unseen.is_far(now.error):
        return None
    best = _outstanding(step, unseen.horizon_s) or _outstanding_observed(step, short, now, unseen)
    return replace(step, tried=_first(best, step.tried), accepted=True, trusted=True) if best else None


def _outstanding(step: Step, horizon_s: float) -> Tried | None:
    """The effect whose error on the training data is far below all others', or before which all others fell out of the
    successive halving."""
    if not step.tried:
        return None
    best, *rest = sorted(step.tried, key=lambda one: one.level.typical)
    if rest:
        return best if best.level.typical < policy.STANDS_OUT * rest[0].level.typical else None
    return best if best.level.horizon_s * LONGER > horizon_s else None


def _outstanding_observed(step: Step, short: Level, now: Judged, unseen: Unseen) -> Tried | None:
    near = step.ahead
    if near is None or near.cost > policy.NEARER * cost_of(short, unseen.task):
        return None
    (best,) = on_unseen([followed_fit(near, unseen.task)], now, unseen)
    return best if math.isfinite(best.judged.error) else None


def _strongest(*scores: Scores) -> list[Direction]:
    """The directions of tests on several fits, each effect once, strongest first."""
    every = [(d.statistic / one.limit, d) for one in scores for d in one.directions]
    return best_of_each(direction for _, direction in sorted(every, key=lambda pair: -pair[0]))


def on_unseen(trials: Sequence[Trial], now: Judged, unseen: Unseen) -> list[Tried]:
    """The trials judged, each beginning segments that it has lost where another one follows them; the best few, when
    the time is up."""
    if is_over():
        trials = sorted(trials, key=lambda trial: trial.level.typical)[: policy.FEWEST]
    judged = unseen.judge_each([trial.level.model for trial in trials], now)
    return [Tried(trial.effect, trial.level, own) for trial, own in zip(trials, judged, strict=True)]


def _first(best: Tried, tried: Sequence[Tried]) -> tuple[Tried, ...]:
    return (best, *(one for one in tried if one is not best))


def _ranked(scores: Scores, every: Sequence[Tried], now: Judged, unseen: Unseen) -> Step:
    """What was tried in the order of what it explains of the unseen data, each effect once; is the first accepted?"""
    if not (finite := [one for one in every if math.isfinite(one.judged.error)]):
        return Step(scores)
    misfit = misfits([one.judged for one in finite]).tolist()
    known = [replace(one, misfit=own) for one, own in zip(finite, misfit, strict=True)]
    tried = tuple(best_of_each(sorted(known, key=lambda one: one.criterion)))
    return Step(scores, tried, accepted=unseen.is_better(tried[0].judged, now))


def _told_by_training(step: Step, level: Level, now: Judged, task: Task, sure: Collection[str]) -> Step | None:
    """The step with an effect put first and accepted of which the unseen data are free, as of a range that they never
    reach, but of which the data of the fit are full.  sure: what is seen in these without a test, and shall only not
    make the unseen data worse."""
    statistic = {d.effect: d.statistic for d in step.scores.directions}
    trained_on = [trained(fit, task.substep_s) for fit in (level, *(one.level for one in step.tried))]
    before, *misfit = misfits(trained_on).tolist()
    tried = [replace(one, misfit=own) for one, own in zip(step.tried, misfit, strict=True)]

    def fills(one: Tried) -> bool:
        gain, errors = before - one.misfit, one.judged.errors
        if one.effect in sure:
            return gain > policy.UNSEEN_GAIN and bool(np.all(errors < (1 + policy.UNSEEN_GAIN) * now.errors))
        is_full = gain > policy.LEAST_GAIN and statistic[one.effect] > policy.FULL * step.scores.limit
        return is_full and np.allclose(errors, now.errors, rtol=policy.UNSEEN_GAIN)

    full = [one for one in tried if fills(one)]
    if not full:
        return None
    ordered = sorted(tried, key=lambda one: one.misfit)
    return Step(step.scores, _first(min(full, key=lambda one: one.misfit), ordered), accepted=True, unvalidated=True)
