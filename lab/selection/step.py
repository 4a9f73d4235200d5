"""One step of the search: candidates fitted, validated on unseen data, and the decision on the best of them.

forward.py repeats the steps.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from lostmotion.lab import policy
from lostmotion.lab.data.clipping import RANGE, at_its_rail
from lostmotion.lab.deadline import is_over
from lostmotion.lab.selection.candidates import (
    FEW_STEPS,
    Trial,
    best_of_each,
    full_trials,
    halving,
    near_trials,
    observer_trials,
    others,
    repaired_trial,
)
from lostmotion.lab.selection.score_test import Scores, score_test
from lostmotion.lab.selection.validate import Judged, Unseen, misfits, trained
from lostmotion.lab.shooting.continuation import Level
from lostmotion.lab.shooting.task import Task

__all__ = ["Step", "Tried", "look_ahead", "on_unseen", "provisional", "searched"]


@dataclass(frozen=True, eq=False)
class Tried:
    """A fit with one more effect, validated on unseen data; misfit: on the data that decided (see ``misfits``)."""

    effect: str
    level: Level
    judged: Judged
    misfit: float = math.nan

    @property
    def parameters(self) -> int:
        """The number of fitted parameters, including whole numbers that are searched."""
        return sum(not p.fixed or p.domain.is_whole for p in self.level.model.parameters.values())


@dataclass(frozen=True, eq=False)
class Step:
    """A fit without, and those with, one more effect, best first; scores of the fit without.

    accepted: the effect of the first one is missing; provisional: accepted as the first of two, as it explains too
    little alone; unvalidated: accepted by the training data, as the unseen data do not show it.
    """

    scores: Scores
    tried: tuple[Tried, ...] = ()
    accepted: bool = False
    provisional: bool = False
    unvalidated: bool = False

    @property
    def equals(self) -> list[Tried]:
        """The accepted effect, and those that explain the deciding data equally well, within ALIKE."""
        if not self.accepted or self.provisional:
            return []
        return [one for one in self.tried if one.misfit < self.tried[0].misfit + policy.ALIKE]


def searched(level: Level, short: Level, now: Judged, unseen: Unseen, rng: np.random.Generator) -> Step:
    """One more effect, if there is evidence for one.  Near the noise the score test of the longest segments proposes;
    far from it that of the short ones, and where none of its proposals is accepted, the search with observers."""
    task, pool = unseen.task, unseen.pool
    is_far = unseen.is_far(max(now.error, level.typical))
    scores = score_test(short if is_far else level, others(level.model), task.substep_s, pool, rng)
    if not is_far or not scores.directions:
        asked = [d for d in scores.directions[: policy.FINISHED] if d.statistic > scores.limit]
        return _near_step(near_trials(level, asked, task, pool), scores, level, now, unseen)
    near = near_trials(short, scores.directions[: policy.FINISHED], task, pool, FEW_STEPS)
    trials, tried = full_trials(near, scores.directions[0].effect, task, pool), list[Tried]()
    if trials and trials[0].level.typical < policy.FAR:
        tried, trials = _halved(trials, now, unseen), []
        step = _ranked(scores, tried, now, unseen)
        if step.accepted:
            return step
    trials += observer_trials(short, task, pool)
    return _ranked(scores, [*tried, *_halved(trials, now, unseen)], now, unseen)


def _halved(trials: Sequence[Trial], now: Judged, unseen: Unseen) -> list[Tried]:
    return on_unseen(halving(trials, unseen.task, unseen.horizon_s, unseen.pool), now, unseen)


def _near_step(trials: Sequence[Trial], scores: Scores, level: Level, now: Judged, unseen: Unseen) -> Step:
    """Judges the effects that the score test proposes, and a limit of the sensor's range where readings saturate: such
    segments are missed, and left out of the test."""
    task = unseen.task
    if RANGE in others(level.model) and (railed := at_its_rail(level.model, task.experiments)):
        trials = [*trials, repaired_trial(RANGE, railed, level, task)]
    if not trials:
        return Step(scores)
    step = _ranked(scores, on_unseen(trials, now, unseen), now, unseen)
    if step.accepted:
        return step
    return _accepted_by_training(step, level, now, task) or step


def look_ahead(step: Step, now: Judged, unseen: Unseen, rng: np.random.Generator) -> list[Step]:
    """The two steps of a pair of effects, of which the first explains too little alone; none where no second one is
    accepted."""
    first = provisional(step, now, unseen)
    if first is None:
        return []
    best = first.tried[0]
    second = searched(best.level, best.level, best.judged, unseen.with_floor_of(best.level), rng)
    return [first, second] if second.accepted and unseen.is_better(second.tried[0].judged, now) else []


def provisional(step: Step, now: Judged, unseen: Unseen) -> Step | None:
    """The step with the effect provisionally accepted that explains most of the training data, although it explains too
    little of the unseen data alone: with two missing effects, impacts are still wrong with one.  None near the noise,
    or where nothing could be fitted."""
    if not step.tried or not unseen.is_far(now.error):
        return None
    best = min(step.tried, key=lambda one: one.level.typical)
    return replace(step, tried=_first(best, step.tried), accepted=True, provisional=True)


def on_unseen(trials: Sequence[Trial], now: Judged, unseen: Unseen) -> list[Tried]:
    """Validates the trials; segments that one has lost start in the state of another one that has not.  Only the best
    trial when the time is up."""
    if is_over():
        trials = sorted(trials, key=lambda trial: trial.level.typical)[:1]
    judged = unseen.judge_each([trial.level.model for trial in trials], now)
    return [Tried(trial.effect, trial.level, own) for trial, own in zip(trials, judged, strict=True)]


def _first(best: Tried, tried: Sequence[Tried]) -> tuple[Tried, ...]:
    return (best, *(one for one in tried if one is not best))


def _ranked(scores: Scores, every: Sequence[Tried], now: Judged, unseen: Unseen) -> Step:
    """Ranks the candidates by the error on unseen data, equal ones by their number of parameters, each effect once, and
    decides whether the first is accepted."""
    if not (finite := [one for one in every if math.isfinite(one.judged.error)]):
        return Step(scores)
    misfit = misfits([one.judged for one in finite]).tolist()
    known = sorted(
        (replace(one, misfit=own) for one, own in zip(finite, misfit, strict=True)), key=lambda one: one.misfit
    )
    alike = [one for one in known if one.misfit < min(misfit) + policy.ALIKE]
    simplest = sorted(alike, key=lambda one: one.parameters)
    tried = tuple(best_of_each([*simplest, *known[len(alike) :]]))
    return Step(scores, tried, accepted=unseen.is_better(tried[0].judged, now))


def _accepted_by_training(step: Step, level: Level, now: Judged, task: Task) -> Step | None:
    """The step with an effect accepted that the training data show and the unseen data do not, such as a sensor range
    that they never reach: none of their segments gets worse."""
    trained_on = [trained(fit, task.substep_s) for fit in (level, *(one.level for one in step.tried))]
    before, *misfit = misfits(trained_on).tolist()
    tried = [replace(one, misfit=own) for one, own in zip(step.tried, misfit, strict=True)]
    tried = sorted(tried, key=lambda one: one.misfit)
    limit = (1 + policy.ALIKE) * now.errors
    full = [o for o in tried if before - o.misfit > policy.LEAST_GAIN and np.all(o.judged.errors < limit)]
    return Step(step.scores, _first(full[0], tried), accepted=True, unvalidated=True) if full else None
