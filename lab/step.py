"""One step of the search: effects tried on a fit, how they do on unseen data, whether the best of them is missing.

What becomes of many steps is explain.py's.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from lostmotion.lab.candidates import Trial, far_trials, further_trials, near_trials
from lostmotion.lab.grow import Level
from lostmotion.lab.heldout import FAR, Judged, Unseen, better, misfits, trained
from lostmotion.lab.scoretest import Direction, Scores, score_test
from lostmotion.lab.task import Task
from lostmotion.model import Model, catalogue

__all__ = ["Step", "further", "promising", "searched"]

STANDS_OUT = 0.75
"""An effect whose error is below this part of the next one's is taken on trust."""
NEAR_TRIALS = 6
ALIKE = 0.02
FREE, FULL, FULL_GAIN = 0.01, 3.0, 0.05
"""An effect of which unseen data are free leaves their errors within this; then it must pass this many times the limit
and lower the misfit of the data of the fit by this."""


@dataclass(frozen=True, eq=False)
class Step:
    """A fit without, and the trials with, one more effect, best first by their misfits; scores of the fit without.

    accepted: the first trial's effect is missing; blind: the unseen data are free of it, the training data said so.
    """

    scores: Scores
    trials: tuple[Trial, ...] = ()
    judged: tuple[Judged, ...] = ()
    misfit: tuple[float, ...] = ()
    accepted: bool = False
    blind: bool = False

    def first(self, order: Sequence[int], misfit: Sequence[float], *, blind: bool = False) -> Step:
        """The step with its trials in this order and the first of them accepted."""
        return replace(
            self,
            trials=tuple(self.trials[i] for i in order),
            judged=tuple(self.judged[i] for i in order),
            misfit=tuple(misfit[i] for i in order),
            accepted=True,
            blind=blind,
        )

    @property
    def equals(self) -> list[Trial]:
        """The effect that was accepted, and what explains the data that decided as well within ALIKE."""
        if not self.accepted:
            return []
        return [trial for trial, one in zip(self.trials, self.misfit, strict=True) if one < self.misfit[0] + ALIKE]


def searched(level: Level, short: Level, now: Judged, unseen: Unseen, rng: np.random.Generator) -> Step:
    """One more effect, if there is evidence for one."""
    task, pool = unseen.task, unseen.pool
    effects = _others(level.model)
    scores = score_test(level, effects, task.substep_s, pool, rng)
    if not scores.directions:
        return Step(scores)
    if near := now.error < FAR and level.typical < FAR:
        asked = [d for d in scores.directions[:NEAR_TRIALS] if d.statistic > scores.limit]
        trials = near_trials(level, asked, task, pool)
    else:
        first = score_test(short, effects, task.substep_s, pool, rng) if short is not level else scores
        directions = _strongest(first, scores)
        trials = far_trials(short, directions, effects, task, unseen.horizon_s, pool)
    step = _ranked(scores, [(trial, unseen.judge(trial.level.model)) for trial in trials], now)
    return (_told_by_training(step, level, now, task) if near and not step.accepted else None) or step


def further(step: Step, short: Level, now: Judged, unseen: Unseen) -> Step:
    """The step with more trials, where the model stays far from the data and the first ones do not help."""
    if now.error < FAR:
        return step
    trials = further_trials(short, _others(short.model), unseen.task, unseen.horizon_s, unseen.pool)
    every = [(trial, unseen.judge(trial.level.model)) for trial in trials]
    return _ranked(step.scores, [*zip(step.trials, step.judged, strict=True), *every], now)


def promising(step: Step, now: Judged, base: str) -> Step | None:
    """The step with a trial put first that explains too little alone, but more of the training data than all others."""
    if base != "play" or now.error < FAR or len(step.trials) < 2:
        return None
    order = np.argsort([trial.level.typical for trial in step.trials], kind="stable")
    first, second = (step.trials[i].level.typical for i in order[:2])
    if not first < STANDS_OUT * second:
        return None
    return step.first([order[0], *(i for i in range(len(step.trials)) if i != order[0])], step.misfit)


def _others(model: Model) -> list[str]:
    return [e.id for e in catalogue() if model.base in e.bases and e.id not in model.effects]


def _strongest(*scores: Scores) -> list[Direction]:
    """The directions of tests on several fits, each effect once, strongest first."""
    every = sorted(((d.statistic / one.limit, d) for one in scores for d in one.directions), key=lambda pair: -pair[0])
    found: dict[str, Direction] = {}
    for _, direction in every:
        found.setdefault(direction.effect, direction)
    return list(found.values())


def _ranked(scores: Scores, every: Sequence[tuple[Trial, Judged]], now: Judged) -> Step:
    """The trials in the order of what they explain of the unseen data, each effect once; is the first one accepted?"""
    if not (finite := [(trial, one) for trial, one in every if math.isfinite(one.error)]):
        return Step(scores)
    tried, judged = zip(*finite, strict=True)
    misfit = misfits(judged).tolist()
    order = sorted(range(len(tried)), key=lambda i: _criterion(misfit[i], judged[i], tried[i]))
    best = {tried[i].effect: i for i in reversed(order)}
    step = Step(scores, tried, judged).first([i for i in order if best[tried[i].effect] == i], misfit)
    return replace(step, accepted=better(step.judged[0], now, tried[0].level.model.base))


def _told_by_training(step: Step, level: Level, now: Judged, task: Task) -> Step | None:
    """The step with an effect put first and accepted of which the unseen data are free, as of a range that they never
    reach, but of which the data of the fit are full."""
    statistic = {d.effect: d.statistic for d in step.scores.directions}
    fits = (level, *(trial.level for trial in step.trials))
    before, *misfit = misfits([trained(fit, task.substep_s) for fit in fits]).tolist()
    full = [
        i for i, (trial, judged) in enumerate(zip(step.trials, step.judged, strict=True))
        if before - misfit[i] > FULL_GAIN and statistic[trial.effect] > FULL * step.scores.limit
        and np.allclose(judged.errors, now.errors, rtol=FREE)
    ]  # fmt: skip
    if not full:
        return None
    best = min(full, key=misfit.__getitem__)
    return step.first(sorted(range(len(misfit)), key=lambda i: (i != best, misfit[i])), misfit, blind=True)


def _criterion(misfit: float, judged: Judged, trial: Trial) -> float:
    """Schwarz's criterion on unseen data, errors within 3 % of each other counting as equal: then fewer parameters,
    whole numbers that are searched among them."""
    parameters = sum(not p.fixed or p.domain.is_whole for p in trial.level.model.parameters.values())
    return round(misfit / 0.03) + 0.01 * parameters * math.log(judged.count)
