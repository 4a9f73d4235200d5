"""The likelihood of gears, which the search of selection/forward.py asks for fits and predictions.

Fits are made by multiple shooting; predictions are those of the segments of an unseen recording.  Where the error is
near the noise, the model is nearly linear in the missing effects, and the score test proposes candidates.  Far from the
noise an effect shifts impacts.  The candidates of the score test are then fitted on longer and longer segments; where
none of them is accepted, those with the least prediction errors of observers are.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace

import numpy as np

from lostmotion.lab import policy
from lostmotion.lab.data.clipping import RANGE, with_clipping
from lostmotion.lab.data.series import rms
from lostmotion.lab.deadline import is_over
from lostmotion.lab.fitting.fit import fit_of, refined_fit
from lostmotion.lab.fitting.strategy import grown, settled, some_tiles, unfitted
from lostmotion.lab.gears.score_test import Scores, score_test
from lostmotion.lab.gears.trials import (
    FEW_STEPS,
    Trial,
    delays,
    full_fits,
    halving,
    near_trials,
    observer_trials,
    repaired_trial,
    with_other_delays,
)
from lostmotion.lab.gears.unseen import Unseen, Validation, compared
from lostmotion.lab.observer.global_search import SEEDS, Optimum, search_effects
from lostmotion.lab.results import Fit
from lostmotion.lab.selection.evidence import Predictions
from lostmotion.lab.selection.nesting import others
from lostmotion.lab.selection.search import Proposals
from lostmotion.lab.shooting.continuation import Level
from lostmotion.lab.shooting.segment import residuals
from lostmotion.lab.shooting.task import Task
from lostmotion.model import Model
from lostmotion.model.effects import get_effect

__all__ = ["SegmentFit", "ShortSegments"]


@dataclass(frozen=True, eq=False)
class SegmentFit:
    """A model of the search with its fits.

    level: the fit on the longest reliable segments; short: the fit on the shortest segments from which it was grown;
    unseen: its predictions; floor: the error of some of the shortest segments, in units of the noise, at least one.
    """

    level: Level
    short: Level
    unseen: Validation
    floor: float = math.nan
    """NaN for a candidate that has not been accepted."""
    alike: tuple[tuple[str, str], ...] = ()
    """Pairs of a delaying effect of the model and another one that predicts as well in its place."""

    @property
    def model(self) -> Model:
        """The model of the fit."""
        return self.level.model

    @property
    def rms(self) -> float:
        """Root mean square error of the unseen segments, in units of the noise.  Those of fits are not comparable, as
        their segments have different lengths."""
        return self.unseen.error

    @property
    def screened(self) -> float:
        """The typical error of the segments by which candidates are selected: far from the noise the shortest ones, as
        no model follows longer ones."""
        return self.level.typical if self.is_near else self.short.typical

    @property
    def count(self) -> int:
        """The number of fitted parameters, including whole numbers that are searched."""
        return sum(not p.fixed or p.domain.is_whole for p in self.model.parameters.values())

    @property
    def is_far(self) -> bool:
        """Whether the error is more than noise, or exceeds the floor, see ``policy.FAR``."""
        worst = max(self.unseen.error, self.level.typical)
        return worst >= policy.FAR * self.floor or worst > policy.UNLIKE_NOISE

    @property
    def is_near(self) -> bool:
        """Whether the fit was accepted, and its error is not far from the noise."""
        return math.isfinite(self.floor) and not self.is_far


@dataclass(frozen=True, eq=False)
class ShortSegments:
    """The ``Likelihood`` of gears.  short: the fit of the model as it is on the shortest segments; unseen: the
    recording that is predicted."""

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

    @property
    def first(self) -> SegmentFit:
        """The fit of the model as it is."""
        level = grown(self.short, self.task)
        return SegmentFit(level, self.short, self.unseen.validate(level.model), self._floor(self.short))

    def _floor(self, short: Level) -> float:
        """See ``SegmentFit.floor``; short: the fit whose model is used."""
        return max(unfitted(short.model, some_tiles(self.task), self.task).typical, 1.0)

    def tries_pairs(self, added: tuple[str, ...]) -> bool:
        """Always."""
        return True

    def damping_pair(self, now: SegmentFit) -> Sequence[str]:
        """None, as gears are driven."""
        return ()

    def proposals(
        self, now: SegmentFit, added: tuple[str, ...], only: Sequence[str] = ()
    ) -> Iterator[Proposals[SegmentFit]]:
        """Near the noise, the fits of the effects with significant scores.  Far from it, those of the effects with the
        largest scores on the shortest segments.  Then those that observers propose, there and where a score is
        significant and the error exceeds the floor, as the minimum with an effect may be far from the values without
        it, even where these follow the shortest segments."""
        task, pool, may = self.task, self.pool, others(now.model)
        trials = list[Trial]()
        scores = self._scores(now.short if now.is_far else now.level, may)
        if now.is_far:
            few = scores.directions[: policy.FINISHED]
            near = near_trials(now.short, few, task, pool, FEW_STEPS)
            begun = [(trial.effect, trial.level.model) for trial in near]
            full = full_fits(begun, task, pool)
            trials = self._longer([one for one in full if policy.is_less(one.level.typical, now.short.typical)])
        if not now.is_far or now.level.typical <= policy.UNLIKE_NOISE:
            if now.is_far and now.level is not now.short:
                scores = self._scores(now.level, may)
            trials += near_trials(now.level, scores.significant[: policy.FINISHED], task, pool)
        first = self._validated(self._with_range(trials, now, may), now, scores)
        yield replace(first, has_more=now.is_far)
        if now.is_far or (scores.significant and now.rms > now.floor):
            yield from self._followed(now, may, scores)

    def _followed(self, now: SegmentFit, may: Sequence[str], scores: Scores) -> Iterator[Proposals[SegmentFit]]:
        """The fits from the minima of the prediction error of observers; far from the noise those of several searches,
        and at last the best minimum, with which a pair may begin."""
        minima, last = dict[str, Optimum](), Proposals[SegmentFit]([])
        for seed in range(SEEDS if now.is_far else 1):
            found = search_effects(now.short, may, self.task, self.pool, seed)
            lower = [one for one in found if one.effect not in minima or _is_lower(one, minima[one.effect])]
            minima |= {one.effect: one for one in reversed(lower)}
            for trials in observer_trials(lower, self.task, self.pool):
                last = self._validated(self._longer(trials), now, scores)
                yield replace(last, has_more=now.is_far)
        if minima and now.is_far and not is_over():
            yield replace(last, fits=[], begin=self._begin(min(minima.values(), key=lambda one: one.cost)))

    def _begin(self, best: Optimum) -> tuple[str, SegmentFit]:
        """The effect of a minimum of the prediction error of observers, and the model there, unfitted.

        Segments do not follow a model that lacks another effect, and a fit to them leaves the minimum: beside viscous
        friction a bar that stiffens by 8.6e9 N/m³ has 9.2e9 there, and -4e9 in the fit; beside it observers come to
        the friction within 1 % (seed 7600)."""
        level = unfitted(best.model, self.task.tiles, self.task)
        return best.effect, SegmentFit(level, level, self.unseen.validate(best.model), self._floor(level))

    def _scores(self, level: Level, may: Sequence[str]) -> Scores:
        """The score test of these effects on the segments of a fit."""
        return score_test(level, may, self.task.substep_s, self.pool, np.random.default_rng(0))

    def _longer(self, trials: Sequence[Trial]) -> list[Trial]:
        """The trials on segments of the length of the unseen ones, see ``halving``."""
        return halving(trials, self.task, self.unseen.horizon_s, self.pool)

    def _with_range(self, trials: Sequence[Trial], now: SegmentFit, may: Sequence[str]) -> list[Trial]:
        """The trials, and where readings saturate that with a limited range of the sensor (may: the candidates).  The
        score test does not see it, as segments with saturated readings are missed and left out."""
        level = now.short if now.is_far else now.level
        railed = with_clipping(level.model, self.task.experiments) if RANGE in may else None
        return [*trials, repaired_trial(RANGE, railed, level, self.task)] if railed else list(trials)

    def _validated(self, trials: Sequence[Trial], now: SegmentFit, scores: Scores) -> Proposals[SegmentFit]:
        """The trials with their predictions, only the best one when the time is up; now: the present fit; scores: the
        score test that proposed them."""
        if is_over():
            trials = sorted(trials, key=lambda trial: trial.level.typical)[:1]
        validations = self.unseen.validate_each([trial.level.model for trial in trials], now.unseen)
        fits = [
            (one.effect, SegmentFit(one.level, one.short or one.level, own))
            for one, own in zip(trials, validations, strict=True)
        ]
        rest = tuple(d.effect for d in scores.directions if d.effect not in {trial.effect for trial in trials})
        return Proposals(
            [(effect, fit) for effect, fit in fits if np.isfinite(fit.rms)],
            rest if is_over() else (),
            rest,
            scores.detectable,
        )

    def accepted(self, fit: SegmentFit, now: SegmentFit, *, is_first: bool = False) -> SegmentFit:
        """The fit on longer segments; with another effect that delays a signal, where that one predicts better: not of
        the first effect of a pair, as no segment is followed without the second one."""
        if math.isfinite(fit.floor):
            return fit
        fit = self._settled(fit if is_first else self._with_best_delay(fit, now))
        return replace(fit, level=grown(fit.level, self.task), floor=self._floor(fit.short))

    def _settled(self, fit: SegmentFit) -> SegmentFit:
        """The fit after it was repeated, see ``settled``.

        Every candidate beside a fit that has not come to its minimum comes nearer to it, and all of them seem to be
        missing: beside a second mode at 233 Hz, which had come to 228.8 Hz with any of nine effects of no size, a
        compliant shaft was named (seed 7900)."""
        level = settled(fit.level, self.task)
        if level is fit.level:
            return fit
        short = level if fit.short is fit.level else fit.short
        return replace(fit, level=level, short=short, unseen=self.unseen.validate(level.model, fit.unseen))

    def _with_best_delay(self, fit: SegmentFit, now: SegmentFit) -> SegmentFit:
        """The fit with that effect of those that delay a signal which predicts best, and of those that predict as well
        the one with the least error on all segments: to first order in their time constants all of them are the same,
        and each has one parameter.  Unseen segments alone preferred a lag of the sensor to one of 0.8 ms of the motor
        (1.46 and 1.48 times the noise); in those of the fits it leaves 1.54 and 1.48 (seed 5700)."""
        swapped = list(with_other_delays(fit.model, self.task))
        new = [effect for effect in fit.model.effects if effect not in now.model.effects]
        if not swapped or not (now.is_far or any(delays(effect) for effect in new)):
            return fit
        trials = self._longer(full_fits([(fit.model.effects[-1], fit.model), *swapped], self.task, self.pool))
        found = [one for _, one in self._validated(trials, fit, Scores()).fits]
        best = min([fit, *found], key=lambda one: one.rms)
        alike = [one for one in [fit, *found] if not self.predictions(one, best).is_better(len(found))]
        again = [one for one in alike if one is not fit]  # on segments of the same length
        is_lost = fit in alike and all(one.model.effects != fit.model.effects for one in again)
        kept = fit if is_lost else self._with_least_error(again)
        pairs = dict.fromkeys(_exchanged(kept.model, one.model) for one in alike)
        kept = fit if kept.model.effects == fit.model.effects else kept
        return replace(kept, alike=tuple(pair for pair in pairs if pair))

    def _with_least_error(self, fits: Sequence[SegmentFit]) -> SegmentFit:
        """Of the fits that miss the fewest segments, fitted or not, the one with the least error on those that none of
        these misses; all have the same segments."""
        parts = [[*residuals(one.model, one.level.segments, self.task.substep_s), *one.unseen.parts] for one in fits]
        errors = np.array([[rms(r) for r in each] for each in parts])
        is_missed = errors >= policy.MISSED * np.median(errors)
        missed = is_missed.sum(axis=1)
        few = np.flatnonzero(missed == missed.min())
        is_followed = ~is_missed[few].any(axis=0)
        sizes = np.array([r.size for r in parts[0]])
        return fits[int(few[np.argmin((errors[few][:, is_followed] ** 2) @ sizes[is_followed])])]

    def refitted(self, model: Model, fit: SegmentFit) -> SegmentFit:
        """The fit of a model with less than another one, from its initial states.  It is grown to longer segments only
        where its error is less than ``policy.BEHIND`` times that with more."""
        short = repaired_trial("", model, fit.level, self.task).level
        is_behind = short.typical > policy.BEHIND * max(fit.level.typical, 1.0)
        level = short if is_behind else grown(short, self.task)
        return SegmentFit(level, short, self.unseen.validate(level.model, fit.unseen), fit.floor, fit.alike)

    def predictions(
        self, one: SegmentFit, other: SegmentFit, *, of_all: bool = False, is_last: bool = False
    ) -> Predictions:
        """The squared errors of two fits on the unseen segments, each with the better of the initial states of both.
        If they differ by a limited range of the sensor, the recordings of the fit are predicted as well, as the limit
        is read off the readings and not fitted."""
        less, more = (
            self.unseen.with_better_states(one.unseen, other.unseen),
            self.unseen.with_better_states(other.unseen, one.unseen),
        )
        own, wide = {*one.model.effects}, {*other.model.effects}
        if wide - own != {RANGE} or own - wide:
            return compared(less, more)
        segments, step = other.level.segments, self.task.substep_s
        before, after = (residuals(fit.model, segments, step) for fit in (one, other))
        return compared(replace(less, parts=(*less.parts, *before)), replace(more, parts=(*more.parts, *after)))

    def on_last(self, one: SegmentFit, other: SegmentFit) -> None:
        """None: the ``predictions`` are of the last recording."""

    def least_gain(self, fit: SegmentFit, now: SegmentFit) -> float:
        """``policy.FAR_GAIN`` where the error stays far from the noise, as almost any effect shifts impacts and
        improves some.  Near the noise ``policy.LEAST_GAIN`` of the part of the squared error that exceeds the noise, as
        an effect that raises the error by 1 % can be significant, or of that share where nothing exceeds it: a delay
        of a nanosecond took 0.0014 (p = 4e-5).  At least the share that the input causes: a compliant shaft took 0.02
        of what the steps of a command had left."""
        if fit.rms >= policy.FAR * now.floor:
            return policy.FAR_GAIN
        exceeding = max(1 - (now.floor / now.rms) ** 2, policy.LEAST_GAIN)
        return max(policy.LEAST_GAIN * exceeding, self.task.input_share)

    def is_sized(self, effect: str, fit: SegmentFit) -> bool:
        """Whether an amplitude of an effect exceeds ``policy.UNSIZED`` half widths of its interval, three standard
        deviations.  Otherwise only the initial values of its states explain something, as those of a second mode that
        is neither driven nor damped explain a hum.  Of what was accepted near the noise the refined fit is asked, too:
        with the step of the search a weight was 1.49 ± 0.2 µN m where there is none, and is 0 ± 0.15 with a fine one
        (seed 7700).  Of candidates it would take up to a third of the time of a search."""
        names = get_effect(effect).amplitude_names

        def exceed(found: Fit) -> bool:
            own = [e for e in found.estimates if e.name in names]
            return not own or any(abs(e.value) > policy.UNSIZED * (e.high - e.low) / 2 for e in own)

        return exceed(fit_of(fit.level, self.task)) and (not fit.is_near or exceed(refined_fit(fit.level, self.task)))


def _exchanged(model: Model, other: Model) -> tuple[str, str] | None:
    """The effect of a model in the place of which another model has another effect, and that effect; None where the
    effects are the same or differ by more."""
    own = [effect for effect in model.effects if effect not in other.effects]
    new = [effect for effect in other.effects if effect not in model.effects]
    return (own[0], new[0]) if len(own) == len(new) == 1 else None


def _is_lower(one: Optimum, other: Optimum) -> bool:
    """Whether the cost of a minimum, a mean of squares as long as they are small, is less by ``policy.is_less``."""
    return policy.is_less(math.sqrt(one.cost), math.sqrt(other.cost))
