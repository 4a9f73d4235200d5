"""The predictions of a fit on an experiment that it has not seen.  Only initial states are estimated there, no
parameters."""

from __future__ import annotations

import math
from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from lostmotion.lab import policy
from lostmotion.lab.data.blocks import correlation, numbered
from lostmotion.lab.data.experiment import Experiment
from lostmotion.lab.data.whiteness import is_structured
from lostmotion.lab.fitting.fit import rms_by_column
from lostmotion.lab.fitting.strategy import observed_states, with_initial_states
from lostmotion.lab.selection.evidence import Predictions
from lostmotion.lab.shooting.continuation import merged, residuals, tiles
from lostmotion.lab.shooting.initial_state import polished, repaired
from lostmotion.lab.shooting.segment import Segment, start_with, state_scales
from lostmotion.lab.shooting.task import Task
from lostmotion.model import Model
from lostmotion.model.motion import FloatArray

__all__ = ["LONGER", "Judged", "Unseen", "compared", "is_left"]

LONGER = 1.2
"""Longest segment, times the requested length."""
POLISHED = 6


@dataclass(frozen=True, eq=False)
class Judged:
    """A model on unseen segments: parts: r of every segment in units of the noise (S arrays), infinite where it cannot
    be simulated; segments: with the estimated initial states."""

    model: Model
    parts: tuple[FloatArray, ...]
    segments: tuple[Segment, ...] = ()

    @cached_property
    def errors(self) -> FloatArray:
        """Root mean square of r of every segment (S,)."""
        return np.array([np.sqrt(np.mean(part**2)) for part in self.parts])

    @property
    def usual(self) -> float:
        """The error of a segment that is surely followed."""
        return float(np.quantile(self.errors, 1 - policy.LOST_SHARE, method="lower"))

    @cached_property
    def kept(self) -> list[int]:
        """The segments that are not lost, best first."""
        return [int(i) for i in np.argsort(self.errors) if self.errors[i] <= policy.LOST * self.usual]

    @cached_property
    def error(self) -> float:
        """Root mean square of r without lost segments."""
        return float(np.sqrt(np.mean(np.concatenate([self.parts[i] for i in self.kept]) ** 2)))

    def of(self, column: str) -> float:
        """Error of a column in its unit, without lost segments; infinite where the model could not be run."""
        return rms_by_column([(self.segments[i], self.parts[i]) for i in self.kept]).get(column, math.inf)


def compared(one: Judged, other: Judged) -> Predictions:
    """Squared errors of two models on the same segments, in blocks of the residual of the second.

    Lost segments count too, as segments that few models predict discriminate best; but their error counts as a multiple
    of the usual one of the better model at most, as chaotic ones are arbitrary.  They say nothing about how long a
    residual is correlated: with one of four segments set to a constant, a block was as long as a segment.
    """
    most = policy.MISSED * min(one.usual, other.usual)
    before, after = (
        np.concatenate([
            part if error < most else np.full(part.size, most)
            for part, error in zip(judged.parts, judged.errors, strict=True)
        ])
        for judged in (one, other)
    )  # fmt: skip
    followed = [part for part, error in zip(other.parts, other.errors, strict=True) if error < most]
    length = policy.BLOCK_CORRELATIONS * correlation(np.concatenate(followed or [after]))
    block = numbered([part.size for part in other.parts], length)
    return Predictions(before**2, after**2, block)


def is_left(judged: Judged) -> bool:
    """Whether the residual of the segments that are surely followed, those with the smallest errors, is more than
    noise."""
    best = judged.kept[: math.ceil((1 - policy.LOST_SHARE) * judged.errors.size)]
    return judged.error > policy.UNLIKE_NOISE or is_structured([judged.parts[i] for i in best])


@dataclass(frozen=True, eq=False)
class Unseen:
    """An unseen experiment and the length of its segments."""

    experiment: Experiment
    task: Task
    horizon_s: float
    pool: Executor

    def judge(self, model: Model, *others: Judged) -> Judged:
        """Validates the model in segments of about this length, with estimated initial states; others: further initial
        guesses of these."""
        return self.again(_judged_on(self, model, *others), *others)

    def judge_each(self, models: Sequence[Model], *others: Judged) -> list[Judged]:
        """Validates several models in parallel, with the initial states of each as guesses for the others."""
        first = list(self.pool.map(self.judge, models, *([other] * len(models) for other in others)))
        return [self.again(own, *first) for own in first]

    def again(self, judged: Judged, *others: Judged) -> Judged:
        """Validates again: segments that this model has lost and another one has not start in the state of the other
        one, as the motion of bar and joint is the same."""
        model, segments, step = judged.model, list(judged.segments), self.task.substep_s
        best = [min(others, key=lambda other: float(other.errors[i]), default=judged) for i in range(len(segments))]
        lost = [i for i, other in enumerate(best) if judged.errors[i] > policy.LOST * other.errors[i]]
        if not lost:
            return judged
        for i in lost:
            segments[i] = _polished(model, segments[i], _state_of(model, best[i].segments[i], best[i].model), step)
        return Judged(model, tuple(residuals(model, segments, step)), tuple(segments))


def _judged_on(unseen: Unseen, model: Model, *others: Judged) -> Judged:
    """From the states of the others where these lead to the noise in every segment: no other state is better there.
    Else from scans of the shortest segments, on longer and longer ones."""
    whole, task, horizon_s = unseen.experiment, unseen.task, unseen.horizon_s
    step, halvings = task.substep_s, task.halvings
    for other in others:
        near = [_segment_with(model, segment, other.model, step) for segment in other.segments]
        judged = Judged(model, tuple(residuals(model, near, step)), tuple(near))
        if np.all(judged.errors < policy.LOST):
            return judged
    pieces = tiles(whole, halvings)
    guesses = observed_states(model, pieces, [whole], task)
    segments = repaired(model, with_initial_states(model, pieces, guesses, task), step)
    while halvings > 0 and whole.duration / 2 ** (halvings - 1) <= horizon_s * LONGER:
        halvings -= 1
        segments = repaired(model, merged(segments, [whole], halvings), step)
        also = [guesses.get((whole.name, float(segment.experiment.time[0]))) for segment in segments]
        segments = tuple(_polished(model, segment, state, step) for segment, state in zip(segments, also, strict=True))
    return Judged(model, tuple(residuals(model, segments, step)), tuple(segments))


def _segment_with(model: Model, there: Segment, other: Model, substep_s: float) -> Segment:
    """Another model's segment for this one, whose initial state begins at that of the other."""
    state = _state_of(model, there, other)
    segment = replace(there, scale=state_scales(model, there.experiment), start=state[0])
    return _polished(model, segment, None, substep_s)


def _state_of(model: Model, there: Segment, other: Model) -> FloatArray:
    return start_with(there.experiment.model(model), there, other.state_names)[None]


def _polished(model: Model, segment: Segment, also: FloatArray | None, substep_s: float) -> Segment:
    own = segment.experiment.model(model)
    states = segment.start[None] if also is None else np.vstack([segment.start, also])
    return segment.starting(polished(own, segment, states, substep_s, POLISHED)[0])
