"""The likelihood of gears: multiple shooting for fits, the segments of an unseen recording for predictions.

Near the noise the model is nearly linear in what is missing, and the score test proposes effects.  Far from it an
effect shifts impacts: what the score test proposes is fitted on longer and longer segments, and then what observers
follow best.  What is searched and what decides is selection/forward.py.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace

import numpy as np

from lostmotion.lab import policy
from lostmotion.lab.data.clipping import RANGE, at_its_rail
from lostmotion.lab.deadline import is_over
from lostmotion.lab.fitting.fit import fit_of
from lostmotion.lab.fitting.strategy import grown, some_tiles, unfitted
from lostmotion.lab.gears.score_test import Scores, score_test
from lostmotion.lab.gears.trials import (
    FEW_STEPS,
    Trial,
    full_fits,
    full_trials,
    halving,
    near_trials,
    observer_trials,
    repaired_trial,
    with_other_delays,
)
from lostmotion.lab.gears.unseen import Judged, Unseen, compared
from lostmotion.lab.selection.evidence import Predictions
from lostmotion.lab.selection.forward import Proposals
from lostmotion.lab.selection.nesting import others, without
from lostmotion.lab.shooting.continuation import Level, residuals
from lostmotion.lab.shooting.task import Task
from lostmotion.model import Model
from lostmotion.model.effects import get_effect

__all__ = ["SegmentFit", "ShortSegments"]


@dataclass(frozen=True, eq=False)
class SegmentFit:
    """level: the fit on the longest segments that can be trusted; short: the one that it grew from; unseen: its
    predictions; floor: the error of the shortest segments, in units of the noise, at least one."""

    level: Level
    short: Level
    unseen: Judged
    floor: float = math.nan
    """Not known of a candidate."""
    alike: tuple[tuple[str, str], ...] = ()
    """Effects that delay, each with another one that predicts as well in its place."""

    @property
    def model(self) -> Model:
        """The model of the fit."""
        return self.level.model

    @property
    def rms(self) -> float:
        """Root mean square error of unseen segments, in units of the noise: those of fits are not equally long."""
        return self.unseen.error

    @property
    def screened(self) -> float:
        """The usual error of the segments that propose candidates: of the shortest ones far from the noise, where
        longer ones are lost, whatever the model."""
        is_near = math.isfinite(self.floor) and not self.is_far
        return self.level.typical if is_near else self.short.typical

    @property
    def count(self) -> int:
        """The number of fitted parameters, including whole numbers that are searched."""
        return sum(not p.fixed or p.domain.is_whole for p in self.model.parameters.values())

    @property
    def is_far(self) -> bool:
        """Whether the error exceeds that of additive disturbances of the readings."""
        return max(self.unseen.error, self.level.typical) >= policy.FAR * self.floor


@dataclass(frozen=True, eq=False)
class ShortSegments:
    """short: the fit of the model as it is on the shortest segments; unseen: the recording that is predicted."""

    short: Level
    unseen: Unseen
    turns: float = 0.0
    is_held_out: bool = True

    @property
    def task(self) -> Task:
        """The task of all fits."""
        return self.unseen.task

    @property
    def pool(self) -> Executor:
        """For fits and predictions."""
        return self.unseen.pool

    def first(self) -> SegmentFit:
        """The fit of the model as it is."""
        level = grown(self.short, self.task)
        return SegmentFit(level, self.short, self.unseen.judge(level.model), self._floor(self.short))

    def _floor(self, short: Level) -> float:
        return max(unfitted(short.model, some_tiles(self.task), self.task).typical, 1.0)

    def firsts(self, added: tuple[str, ...]) -> int:
        """One: a step takes up to a minute."""
        return 1

    def opposed(self, now: SegmentFit) -> Sequence[str]:
        """None: gears are driven."""
        return ()

    def proposals(
        self, now: SegmentFit, added: tuple[str, ...], only: Sequence[str] = ()
    ) -> Iterator[Proposals[SegmentFit]]:
        """What the score test proposes; then what observers propose, or where the shortest segments are near the noise
        the best of the full fits of all effects: there each has its minimum beside the values without it."""
        task, pool, level = self.task, self.pool, now.short if now.is_far else now.level
        may = others(now.model)
        scores = score_test(level, may, task.substep_s, pool, np.random.default_rng(0))
        if not now.is_far or not scores.directions:
            asked = [d for d in scores.directions[: policy.FINISHED] if d.statistic > scores.limit]
            yield self._judged(self._with_range(near_trials(level, asked, task, pool), level, may), now, scores)
            return
        few, rest = scores.directions[: policy.FINISHED], scores.directions[policy.FINISHED :]
        near = near_trials(level, few, task, pool, FEW_STEPS)
        trials = full_trials(near, few[0].effect, task, pool)
        least = math.sqrt(1 - policy.LEAST_GAIN) * level.typical
        yield self._judged(self._longer([trial for trial in trials if trial.level.typical < least]), now, scores)
        if level.typical > policy.FAR:
            yield self._judged(self._longer(observer_trials(now.short, may, task, pool)), now, scores)
            return
        near += near_trials(level, rest, task, pool, FEW_STEPS)
        fitted = {trial.effect for trial in trials}
        more = full_fits([(one.effect, one.level.model) for one in near if one.effect not in fitted], task, pool)
        yield self._judged(self._longer(more[: policy.FINISHED]), now, scores)

    def _longer(self, trials: Sequence[Trial]) -> list[Trial]:
        return halving(trials, self.task, self.unseen.horizon_s, self.pool)

    def _with_range(self, trials: Sequence[Trial], level: Level, may: Sequence[str]) -> list[Trial]:
        """With the limit of the sensor's range where readings saturate: such segments are missed, and left out of the
        score test."""
        railed = at_its_rail(level.model, self.task.experiments) if RANGE in may else None
        return [*trials, repaired_trial(RANGE, railed, level, self.task)] if railed else list(trials)

    def _judged(self, trials: Sequence[Trial], now: SegmentFit, scores: Scores) -> Proposals[SegmentFit]:
        """With predictions; segments that one has lost start in the state of another one that has not.  Only the best
        trial when the time is up."""
        if is_over():
            trials = sorted(trials, key=lambda trial: trial.level.typical)[:1]
        judged = self.unseen.judge_each([trial.level.model for trial in trials], now.unseen)
        fits = [
            (one.effect, SegmentFit(one.level, one.short or one.level, own))
            for one, own in zip(trials, judged, strict=True)
        ]
        rest = tuple(d.effect for d in scores.directions if d.effect not in {trial.effect for trial in trials})
        return Proposals(
            [(effect, fit) for effect, fit in fits if np.isfinite(fit.rms)],
            rest if is_over() else (),
            rest,
            scores.detectable,
        )

    def accepted(self, fit: SegmentFit, now: SegmentFit) -> SegmentFit:
        """The fit on longer segments, with another effect that delays where that explains more."""
        if math.isfinite(fit.floor):
            return fit
        fit = self._with_best_delay(fit, now)
        return replace(fit, level=grown(fit.level, self.task), floor=self._floor(fit.short))

    def _with_best_delay(self, fit: SegmentFit, now: SegmentFit) -> SegmentFit:
        """The fit with the effect that predicts best of those that delay a signal, and the effects that predict as well
        in its place: to first order in their time constants all of them are the same.  The fit is kept where it is one
        of those."""
        swapped = list(with_other_delays(fit.model, self.task))
        new = [effect for effect in fit.model.effects if effect not in now.model.effects]
        if not swapped or not (now.is_far or any(get_effect(effect).delays_by for effect in new)):
            return fit
        trials = self._longer(full_fits([("", fit.model), *swapped], self.task, self.pool))
        others = [one for _, one in self._judged(trials, fit, Scores()).fits]
        best = min([fit, *others], key=lambda one: one.rms)
        alike = [one for one in [fit, *others] if not self._is_better(best, one, len(others))]
        kept = fit if fit in alike else best
        pairs = (_exchanged(kept.model, one.model) for one in alike)
        return replace(kept, alike=tuple(pair for pair in pairs if pair))

    def _is_better(self, one: SegmentFit, other: SegmentFit, tried: int) -> bool:
        """Whether one fit predicts better than another, significantly for so many that were tried."""
        predictions = self.predictions(other, one)
        return predictions.gain > policy.LEAST_GAIN and tried * predictions.p_value < policy.FALSE_NAME

    def without(self, effect: str, fit: SegmentFit) -> SegmentFit:
        """The fit without an effect, from the initial states of the one with it; on longer segments only where it does
        not fall behind."""
        short = repaired_trial("", without(fit.model, effect), fit.level, self.task).level
        is_behind = short.typical > policy.BEHIND * max(fit.level.typical, 1.0)
        level = short if is_behind else grown(short, self.task)
        return SegmentFit(level, short, self.unseen.judge(level.model, fit.unseen), fit.floor, fit.alike)

    def predictions(self, one: SegmentFit, other: SegmentFit, *, of_all: bool = False) -> Predictions:
        """Errors of unseen segments, each with the better of the initial states that both have found.  A limit of the
        sensor's range is read off the readings, not fitted: the recordings of the fit judge it, too."""
        less, more = self.unseen.again(one.unseen, other.unseen), self.unseen.again(other.unseen, one.unseen)
        own, wide = {*one.model.effects}, {*other.model.effects}
        if wide - own != {RANGE} or own - wide:
            return compared(less, more)
        segments, step = other.level.segments, self.task.substep_s
        before, after = (residuals(fit.model, segments, step) for fit in (one, other))
        return compared(replace(less, parts=(*less.parts, *before)), replace(more, parts=(*more.parts, *after)))

    def least_gain(self, fit: SegmentFit, now: SegmentFit) -> float:
        """More where the error stays far from the noise: almost any effect shifts impacts, and improves some.  Near it
        the share of what exceeds the noise: an effect that raises the error by 1 % can be significant."""
        if fit.rms >= policy.FAR * now.floor:
            return policy.FAR_GAIN
        return policy.LEAST_GAIN * max(1 - (now.floor / now.rms) ** 2, 0.0)

    def is_sized(self, effect: str, fit: SegmentFit) -> bool:
        """Whether an amplitude differs from zero by three standard deviations: otherwise only the initial values of an
        effect's states explain something, as those of a second mode that is neither driven nor damped explain a hum."""
        names = [f"{effect}.{name}" for name in get_effect(effect).amplitudes]
        own = [e for e in fit_of(fit.level, self.task).estimates if e.name in names]
        return not own or any(abs(e.value) > policy.UNSIZED * (e.high - e.low) / 2 for e in own)


def _exchanged(model: Model, other: Model) -> tuple[str, str] | None:
    """The effect that another model has another one for, and that; None where they are the same or differ by more."""
    own = [effect for effect in model.effects if effect not in other.effects]
    new = [effect for effect in other.effects if effect not in model.effects]
    return (own[0], new[0]) if len(own) == len(new) == 1 else None
