"""Fitting on a growing horizon: many short segments first, then half as many of twice the length, up to the whole.

The error of a long free simulation of gears has a local minimum for every confusion of impacts; that of half a second
has hardly any.  Each level begins with the result of the one before.  least_squares.py minimises; there is no search
here.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lostmotion.lab import policy
from lostmotion.lab.data.experiment import Experiment
from lostmotion.lab.shooting.least_squares import Problem, minimise
from lostmotion.lab.shooting.parameters import Unknowns
from lostmotion.lab.shooting.segment import Segment
from lostmotion.model import Model
from lostmotion.model.motion import FloatArray

__all__ = [
    "Level",
    "errors",
    "first_level",
    "fitted",
    "followed",
    "merged",
    "missing",
    "residuals",
    "tiles",
]

FIRST_S = {"play": 0.25, "joint": 1.0, "servo": 0.75}
"""Length of the first segments [s] where the motion is chaotic, drifts, or may stick at the wrong place."""
FIRST_SAMPLES = 1024
"""The same for other motions: short enough that a part of them is representative."""
OUTSIDE = 2.0  # medians of |r|: further out a residual counts by its magnitude
LEAST_HUBER = 3.0


@dataclass(frozen=True, eq=False)
class Level:
    """A fit with segments of one length: the model, the initial states, the size of r (in units of the noise).

    rms: root mean square over all; typical: 1.48 medians of |r|, which is robust to a few missed segments.
    """

    model: Model
    unknowns: Unknowns
    z: FloatArray
    segments: tuple[Segment, ...]
    rms: float
    typical: float

    @property
    def horizon_s(self) -> float:
        """Length of the longest segment [s]."""
        return max(segment.experiment.duration for segment in self.segments)


def first_level(base: str, experiment: Experiment) -> int:
    """How often to halve the record for the first segments."""
    first = FIRST_S.get(base, FIRST_SAMPLES / experiment.rate_hz)
    return max(0, math.ceil(math.log2(max(experiment.duration / first, 1.0)) - 0.2))


def tiles(experiment: Experiment, halvings: int) -> list[Experiment]:
    """The record in 2^halvings segments of equal length."""
    edges = np.linspace(experiment.time[0], experiment.time[-1], 2**halvings + 1)
    edges[-1] += 1.0
    return [experiment.between(a, b) for a, b in itertools.pairwise(edges)]


def merged(segments: Sequence[Segment], experiments: Sequence[Experiment], halvings: int) -> tuple[Segment, ...]:
    """Segments of 2^halvings a record, each with the initial state of the shorter one that began there."""
    known = {(s.experiment.name, float(s.experiment.time[0])): s for s in segments}
    longer = []
    for experiment in experiments:
        for tile in tiles(experiment, halvings):
            old = known[experiment.name, float(tile.time[0])]
            longer.append(Segment(tile, old.noise, old.scale, old.start))
    return tuple(longer)


def residuals(model: Model, segments: Sequence[Segment], substep_s: float) -> list[FloatArray]:
    """r of each segment, in units of the noise."""
    return [s.residual(s.experiment.model(model), s.start, substep_s) for s in segments]


def _huber_of(model: Model, segments: Sequence[Segment], substep_s: float) -> float:
    """The bound of Huber's cost, from the present residuals."""
    r = np.concatenate(residuals(model, segments, substep_s))
    middle = float(np.median(np.abs(r[np.isfinite(r)]))) if np.any(np.isfinite(r)) else LEAST_HUBER
    return max(LEAST_HUBER, OUTSIDE * middle)


def fitted(
    model: Model,
    unknowns: Unknowns,
    segments: Sequence[Segment],
    substep_s: float,
    *,
    iterations: int = 15,
    quadratic: bool = False,
) -> Level:
    """One level: minimises from the model's values and the segments' start states.

    Segments of gears that the model misses, due to a wrong initial state, have no weight in the parameters.
    """
    z = unknowns.z(model)
    missed = missing(model, segments, substep_s)
    good = [segment for segment, out in zip(segments, missed, strict=True) if not out]
    huber = math.inf if quadratic else _huber_of(model, good, substep_s)
    problem = Problem(model, unknowns, z, substep_s, huber)
    solution = minimise(problem, z, good, iterations=iterations)
    better = iter(solution.segments)
    every = tuple(segment if out else next(better) for segment, out in zip(segments, missed, strict=True))
    found = unknowns.put(model, solution.z)
    r = np.concatenate(residuals(found, every, substep_s))
    rms, typical = float(np.sqrt(np.mean(r**2))), 1.4826 * float(np.median(np.abs(r)))
    return Level(found, unknowns, solution.z, every, rms, typical)


def errors(model: Model, segments: Sequence[Segment], substep_s: float) -> FloatArray:
    """Root mean square of r of each segment."""
    return np.array([np.sqrt(np.mean(r**2)) for r in residuals(model, segments, substep_s)])


def missing(model: Model, segments: Sequence[Segment], substep_s: float) -> NDArray[np.bool_]:
    """Which segments of gears are missed: their error is several times that of the better ones, or infinite.

    In other motions the initial state decays, so that errors are those of the model.
    """
    return outliers(errors(model, segments, substep_s)) & (model.base == "play")


def followed(level: Level, substep_s: float) -> list[Segment]:
    """The segments of a level that are not missed."""
    missed = missing(level.model, level.segments, substep_s)
    return [segment for segment, out in zip(level.segments, missed, strict=True) if not out]


def outliers(error: FloatArray) -> NDArray[np.bool_]:
    """Errors (S,) of three times the better third's and more, none below three times the noise."""
    return np.asarray(error > policy.MISSED * max(float(np.quantile(error, 0.3, method="lower")), 1.0))
