"""Validation of a fit on unseen data.  Only initial states are estimated there, no parameters."""

from __future__ import annotations

import math
from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from lostmotion.lab import policy
from lostmotion.lab.data.blocks import chance, correlation, numbered
from lostmotion.lab.data.experiment import Experiment
from lostmotion.lab.data.stationarity import is_structured
from lostmotion.lab.fitting.fit import rms_by_column
from lostmotion.lab.fitting.strategy import begun, passed, started, subset
from lostmotion.lab.shooting.continuation import Level, merged, residuals, tiles
from lostmotion.lab.shooting.initial_state import polished, repaired
from lostmotion.lab.shooting.segment import Segment, start_with
from lostmotion.lab.shooting.task import Task
from lostmotion.model import Model
from lostmotion.model.motion import FloatArray

__all__ = ["LONGER", "Judged", "Unseen", "better", "is_left", "misfits", "p_of_gain", "trained"]

LONGER = 1.2
"""Longest segment, times the requested length."""
POLISHED = 6


@dataclass(frozen=True, eq=False)
class Judged:
    """A fit on unseen data: parts: r of every segment in units of the noise (S arrays), infinite where it cannot be
    simulated; segments: with the estimated initial states; states: the names of these."""

    parts: tuple[FloatArray, ...]
    segments: tuple[Segment, ...] = ()
    states: tuple[str, ...] = ()

    @cached_property
    def errors(self) -> FloatArray:
        """Root mean square of r of every segment (S,)."""
        return np.array([np.sqrt(np.mean(part**2)) for part in self.parts])

    @cached_property
    def counts(self) -> FloatArray:
        """Samples of every segment (S,)."""
        return np.array([float(part.size) for part in self.parts])

    @cached_property
    def kept(self) -> list[int]:
        """The segments that are not lost, best first."""
        return [int(i) for i in np.argsort(self.errors) if self.errors[i] <= policy.LOST * _usual(self.errors)]

    @cached_property
    def error(self) -> float:
        """Root mean square of r without lost segments."""
        return float(np.sqrt(np.mean(np.concatenate([self.parts[i] for i in self.kept]) ** 2)))

    def of(self, column: str) -> float:
        """Error of a column in its unit, without lost segments; infinite where the model could not be run."""
        return rms_by_column([(self.segments[i], self.parts[i]) for i in self.kept]).get(column, math.inf)


def misfits(judged: Sequence[Judged]) -> FloatArray:
    """The mean logarithm of each one's errors (J,): differences times the count are those of log-likelihoods with a
    separate noise variance for each segment.

    Lost segments count too, as segments that few models predict discriminate best; but errors are clipped at a multiple
    of the usual error of the best, as chaotic ones are arbitrary.
    """
    end = policy.MISSED * min(_usual(one.errors) for one in judged)
    return np.array([np.average(np.log(np.clip(one.errors, 1e-9, end)), weights=one.counts) for one in judged])


def better(judged: Judged, now: Judged, is_far: bool = False) -> bool:
    """Whether the added effect explains enough: near the noise more than counts as equal, far from it a large share, as
    almost any effect shifts impacts and improves some."""
    if is_far:
        return judged.error < policy.FAR_GAIN * now.error
    before, after = misfits([now, judged])
    return bool(before - after > policy.ALIKE)


def is_left(judged: Judged) -> bool:
    """Whether the residual of the segments that are surely followed, those with the smallest errors, is more than
    noise."""
    best = judged.kept[: math.ceil((1 - policy.LOST_SHARE) * judged.errors.size)]
    return judged.error > policy.UNLIKE_NOISE or is_structured([judged.parts[i] for i in best])


def p_of_gain(judged: Judged, now: Judged, tried: int) -> float:
    """The p-value of the gain of the best of so many effects on unseen data: a t-test of the errors of both models,
    block by block, of segments that neither has lost; one where there is none."""
    both = sorted({*judged.kept} & {*now.kept})
    if not both:
        return 1.0
    # a motion that cannot be simulated has infinite errors
    before, after = (np.clip(np.concatenate([one.parts[i] for i in both]), -1e6, 1e6) for one in (now, judged))
    block = numbered([judged.parts[i].size for i in both], policy.BLOCK_CORRELATIONS * correlation(after))
    return min(tried * chance(before**2, after**2, block), 1.0)


def _usual(errors: FloatArray) -> float:
    return float(np.quantile(errors, 1 - policy.LOST_SHARE, method="lower"))


@dataclass(frozen=True, eq=False)
class Unseen:
    """An unseen experiment and the length of its segments; floor: the error of the fit on the shortest segments, in
    units of the noise, at least one."""

    experiment: Experiment
    task: Task
    horizon_s: float
    pool: Executor
    floor: float = 1.0

    def with_floor_of(self, short: Level) -> Unseen:
        """The same, with the floor from this first fit."""
        return replace(self, floor=max(started(short.model, subset(self.task), self.task).typical, 1.0))

    def is_far(self, error: float) -> bool:
        """Whether an error, in units of the noise, exceeds that of additive disturbances of the readings."""
        return error >= policy.FAR * self.floor

    def is_better(self, judged: Judged, now: Judged) -> bool:
        """Whether the added effect explains enough; see ``better``."""
        return better(judged, now, self.task.rough.base == "play" and self.is_far(judged.error))

    def judge(self, model: Model, *others: Judged) -> Judged:
        """Validates the model in segments of about this length, with estimated initial states; others: further initial
        guesses of these.

        Up to two fifths of the segments are left out as lost: chaotic, or without a good initial state.
        """
        return self.again(model, _judged_on(self.experiment, model, self.task, self.horizon_s), *others)

    def judge_each(self, models: Sequence[Model], *others: Judged) -> list[Judged]:
        """Validates several models in parallel, with the initial states of each as guesses for the others."""
        count = len(models)
        alone = self.pool.map(
            _judged_on, [self.experiment] * count, models, [self.task] * count, [self.horizon_s] * count
        )
        first = [self.again(model, own, *others) for model, own in zip(models, alone, strict=True)]
        return [self.again(model, own, *first) for model, own in zip(models, first, strict=True)]

    def again(self, model: Model, judged: Judged, *others: Judged) -> Judged:
        """Validates again: segments that this model has lost and another one has not start in the state of the other
        one, as the motion of bar and joint is the same."""
        segments, step = list(judged.segments), self.task.substep_s
        best = [min(others, key=lambda other: float(other.errors[i]), default=judged) for i in range(len(segments))]
        lost = [i for i, other in enumerate(best) if judged.errors[i] > policy.LOST * other.errors[i]]
        if not lost:
            return judged
        for i in lost:
            own, there = segments[i].experiment.model(model), best[i].segments[i]
            segments[i] = _polished(model, segments[i], start_with(own, there, best[i].states)[None], step)
        return Judged(tuple(residuals(model, segments, step)), tuple(segments), model.state_names)


def _judged_on(whole: Experiment, model: Model, task: Task, horizon_s: float) -> Judged:
    step, halvings = task.substep_s, task.halvings
    pieces = tiles(whole, halvings)
    likely = passed(model, pieces, [whole], task)
    segments = repaired(model, begun(model, pieces, likely, task), step)
    while halvings > 0 and whole.duration / 2 ** (halvings - 1) <= horizon_s * LONGER:
        halvings -= 1
        segments = repaired(model, merged(segments, [whole], halvings), step)
        also = [likely.get((whole.name, float(segment.experiment.time[0]))) for segment in segments]
        segments = tuple(_polished(model, segment, state, step) for segment, state in zip(segments, also, strict=True))
    return Judged(tuple(residuals(model, segments, step)), tuple(segments), model.state_names)


def trained(level: Level, substep_s: float) -> Judged:
    """The fit on its training segments."""
    return Judged(tuple(residuals(level.model, level.segments, substep_s)))


def _polished(model: Model, segment: Segment, also: FloatArray | None, substep_s: float) -> Segment:
    own = segment.experiment.model(model)
    states = segment.start[None] if also is None else np.vstack([segment.start, also])
    return segment.starting(polished(own, segment, states, substep_s, POLISHED)[0])
