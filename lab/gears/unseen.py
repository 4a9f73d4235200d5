"""The predictions of fits on an experiment that no fit has used, in segments.

Only the initial states of the segments are estimated there, no parameters.  The likelihood of gears compares models by
these predictions.
"""

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
from lostmotion.lab.data.series import rms
from lostmotion.lab.data.whiteness import is_structured
from lostmotion.lab.fitting.fit import by_column, rms_by_column
from lostmotion.lab.fitting.strategy import observed_states, with_initial_states
from lostmotion.lab.selection.evidence import Predictions
from lostmotion.lab.shooting.continuation import LONGER, merged, tiles
from lostmotion.lab.shooting.initial_state import repaired, with_best_starts
from lostmotion.lab.shooting.segment import Segment, residuals, start_with, state_scales
from lostmotion.lab.shooting.task import Task
from lostmotion.model import Model
from lostmotion.model.motion import FloatArray

__all__ = ["Unseen", "Validation", "compared", "exceeds_noise"]

POLISHED = 6
"""Steps of the fits of initial states."""


@dataclass(frozen=True, eq=False)
class Validation:
    """The errors of a model on S unseen segments.

    parts: the residual of each segment, in units of the noise, infinite where the motion cannot be simulated; segments:
    with their estimated initial states.
    """

    model: Model
    parts: tuple[FloatArray, ...]
    segments: tuple[Segment, ...] = ()

    @cached_property
    def errors(self) -> FloatArray:
        """Root mean square of the residual of each segment (S,)."""
        return np.array([rms(part) for part in self.parts])

    @property
    def usual(self) -> float:
        """The quantile 1 - ``policy.LOST_SHARE`` of the errors, that of a segment which the model surely follows."""
        return float(np.quantile(self.errors, 1 - policy.LOST_SHARE, method="lower"))

    @cached_property
    def kept(self) -> list[int]:
        """The numbers of the segments that are not lost (``policy.LOST``), the one with the least error first."""
        return [int(i) for i in np.argsort(self.errors) if self.errors[i] <= policy.LOST * self.usual]

    @cached_property
    def error(self) -> float:
        """Root mean square of the residuals of all segments that are not lost."""
        return rms(*(self.parts[i] for i in self.kept))

    def of(self, column: str) -> float:
        """The error of a column in its unit, without lost segments; infinite where the model cannot be simulated."""
        return rms_by_column([(self.segments[i], self.parts[i]) for i in self.kept]).get(column, math.inf)


def compared(one: Validation, other: Validation) -> Predictions:
    """The squared errors of two models on the same segments, in blocks of the residual of the second.

    Lost segments are compared as well, as segments that few models predict discriminate best.  Their errors are clipped
    at ``policy.MISSED`` times the usual error of the better model, as those of chaotic ones are arbitrary.  The length
    of blocks follows from the other segments: with one of four segments set to a constant, a block was as long as a
    segment.
    """
    most = policy.MISSED * min(one.usual, other.usual)
    before, after = (
        np.concatenate([
            part if error < most else np.full(part.size, most)
            for part, error in zip(validation.parts, validation.errors, strict=True)
        ])
        for validation in (one, other)
    )  # fmt: skip
    followed = [part for part, error in zip(other.parts, other.errors, strict=True) if error < most]
    length = policy.BLOCK_CORRELATIONS * correlation(np.concatenate(followed or [after]))
    block = numbered([part.size for part in other.parts], length)
    return Predictions(before**2, after**2, block)


def exceeds_noise(validation: Validation) -> bool:
    """Whether the residual of a model is more than noise: it is larger than ``policy.UNLIKE_NOISE``, or in the main
    column has structure in the segments with the smallest errors, which the model surely follows.  The noise of other
    columns may be rounding, or wrong: a variance that changes from column to column is no structure."""
    if validation.error > policy.UNLIKE_NOISE:
        return True
    best = validation.kept[: math.ceil((1 - policy.LOST_SHARE) * validation.errors.size)]
    return is_structured([next(iter(by_column(validation.segments[i], validation.parts[i]).values())) for i in best])


@dataclass(frozen=True, eq=False)
class Unseen:
    """An unseen experiment, the task of the fits, the length of its segments [s], and an executor."""

    experiment: Experiment
    task: Task
    horizon_s: float
    pool: Executor

    def validate(self, model: Model, *others: Validation) -> Validation:
        """The errors of a model in segments of about this length, with estimated initial states; others: validations
        whose initial states are guesses for these."""
        return self.with_better_states(_validated_on(self, model, *others), *others)

    def validate_each(self, models: Sequence[Model], *others: Validation) -> list[Validation]:
        """The errors of several models, each with the initial states of the others as guesses for its own."""
        first = list(self.pool.map(self.validate, models, *([other] * len(models) for other in others)))
        return [self.with_better_states(own, *first) for own in first]

    def with_better_states(self, validation: Validation, *others: Validation) -> Validation:
        """The validation in which segments that another model follows better begin anew from their own state and from
        that of the other one, as the motion of bar and joint is the same.

        Otherwise a candidate, which begins with the states of the present model, takes what these states cost: where
        nothing was missing, three candidates took 3 to 6 % (a weight p = 0.02), and take at most 0.1 % so (seed 7700).
        """
        model, segments, step = validation.model, list(validation.segments), self.task.substep_s
        best = [min(others, key=lambda other: float(other.errors[i]), default=validation) for i in range(len(segments))]
        worse = [i for i, other in enumerate(best) if validation.errors[i] > other.errors[i]]
        if not worse:
            return validation
        also = [_state_of(model, best[i].segments[i], best[i].model) for i in worse]
        for i, anew in zip(worse, _polished(model, [segments[i] for i in worse], also, step), strict=True):
            segments[i] = anew
        return Validation(model, tuple(residuals(model, segments, step)), tuple(segments))


def _validated_on(unseen: Unseen, model: Model, *others: Validation) -> Validation:
    """The errors of a model with initial states from another validation, if these lead to errors near the noise in
    every segment, as no other states are better then; else from scans of the shortest segments, on longer and longer
    ones."""
    whole, task, horizon_s = unseen.experiment, unseen.task, unseen.horizon_s
    step, halvings = task.substep_s, task.halvings
    for other in others:
        near = _segments_with(model, other, step)
        validation = Validation(model, tuple(residuals(model, near, step)), tuple(near))
        if np.all(validation.errors < policy.LOST):
            return validation
    pieces = tiles(whole, halvings)
    guesses = observed_states(model, pieces, [whole], task)
    segments = repaired(model, with_initial_states(model, pieces, guesses, task), step)
    while halvings > 0 and whole.duration / 2 ** (halvings - 1) <= horizon_s * LONGER:
        halvings -= 1
        segments = repaired(model, merged(segments, [whole], halvings), step)
        also = [guesses.get((whole.name, float(segment.experiment.time[0]))) for segment in segments]
        segments = tuple(_polished(model, segments, also, step))
    return Validation(model, tuple(residuals(model, segments, step)), tuple(segments))


def _segments_with(model: Model, other: Validation, substep_s: float) -> list[Segment]:
    """The segments of another model, with initial states for this model that are fitted from those of the other one."""
    states = [_state_of(model, there, other.model)[0] for there in other.segments]
    segments = [
        replace(there, scale=state_scales(model, there.experiment), start=state)
        for there, state in zip(other.segments, states, strict=True)
    ]
    return _polished(model, segments, [None] * len(segments), substep_s)


def _state_of(model: Model, there: Segment, other: Model) -> FloatArray:
    """The initial state of another model's segment as one of this model (1, n)."""
    return start_with(there.experiment.model(model), there, other.state_names)[None]


def _polished(
    model: Model, segments: Sequence[Segment], also: Sequence[FloatArray | None], substep_s: float
) -> list[Segment]:
    """The segments with the best initial states that a few steps from their own and from other guesses (K, n), or none,
    lead to."""
    states = [
        segment.start[None] if more is None else np.vstack([segment.start, more])
        for segment, more in zip(segments, also, strict=True)
    ]
    return with_best_starts(model, segments, states, substep_s, POLISHED)
