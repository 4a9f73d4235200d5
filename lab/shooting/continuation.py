"""Multiple shooting on a growing horizon: fits on many short segments, then on half as many of twice the length, and so
on up to whole recordings.

The error of a long free simulation of gears has a local minimum for every way in which impacts can be confused; that of
half a second has hardly any.  Each level begins with the result of the level before.  The minimiser is
least_squares.py; the order of the fits is fitting/strategy.py.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lostmotion.lab import policy
from lostmotion.lab.data.checks import SHORTEST_S
from lostmotion.lab.data.experiment import Experiment
from lostmotion.lab.data.series import rms
from lostmotion.lab.shooting.least_squares import Problem, minimise
from lostmotion.lab.shooting.parameters import Unknowns
from lostmotion.lab.shooting.segment import Segment, residuals
from lostmotion.model import Model
from lostmotion.model.motion import FloatArray

__all__ = [
    "LONGER",
    "Level",
    "are_missed",
    "errors",
    "first_level",
    "fitted",
    "followed_segments",
    "merged",
    "tiles",
]

FIRST_S = {"play": SHORTEST_S, "joint": 1.0, "servo": 0.75}
"""By base, the largest length of the shortest segments [s], where the motion is chaotic, drifts, or may stick at the
wrong place."""
FIRST_SAMPLES = 1024
"""The same for other bases, in samples: a sample of such segments is representative."""
LONGER = 1.2
"""Largest ratio of the length of segments to the requested length."""
OUTSIDE, LEAST_HUBER = 2.0, 3.0
"""Bound of Huber's cost, in medians of |r|, and its least value, in units of the noise."""


@dataclass(frozen=True, eq=False)
class Level:
    """A fit on segments of one length.

    model: with the fitted values; unknowns, z: the free parameters and the vector of their values (P,); segments: with
    their fitted initial states; rms: root mean square of all residuals r, in units of the noise; typical: 1.48 times
    the median of |r|, which is robust to a few missed segments.
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
    """How often to halve an experiment to get segments of the shortest length."""
    first = FIRST_S.get(base, FIRST_SAMPLES / experiment.rate_hz)
    return max(0, math.ceil(math.log2(max(experiment.duration / first, 1.0)) - 0.2))


def tiles(experiment: Experiment, halvings: int) -> list[Experiment]:
    """An experiment in 2^halvings segments of equal length."""
    edges = np.linspace(experiment.time[0], experiment.time[-1], 2**halvings + 1)
    edges[-1] += 1.0
    return [experiment.between(a, b) for a, b in itertools.pairwise(edges)]


def merged(segments: Sequence[Segment], experiments: Sequence[Experiment], halvings: int) -> tuple[Segment, ...]:
    """The experiments in 2^halvings segments each, with the initial states of the shorter segments that begin at the
    same time."""
    known = {(s.experiment.name, float(s.experiment.time[0])): s for s in segments}
    longer = []
    for experiment in experiments:
        for tile in tiles(experiment, halvings):
            old = known[experiment.name, float(tile.time[0])]
            longer.append(Segment(tile, old.noise, old.scale, old.start))
    return tuple(longer)


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
    """Fits the parameters and the initial states of all segments, from the values of the model and of the segments.

    substep_s: integration step [s]; iterations: largest number of steps; quadratic: whether the cost is the sum of
    squares, not Huber's.  Segments of gears that the model misses, due to a wrong initial state, have no weight in the
    parameters.
    """
    z = unknowns.z(model)
    missed = are_missed(model, segments, substep_s)
    good = [segment for segment, out in zip(segments, missed, strict=True) if not out]
    huber = math.inf if quadratic else _huber_of(model, good, substep_s)
    problem = Problem(model, unknowns, z, substep_s, huber)
    solution = minimise(problem, z, good, iterations=iterations)
    better = iter(solution.segments)
    every = tuple(segment if out else next(better) for segment, out in zip(segments, missed, strict=True))
    found = unknowns.put(model, solution.z)
    r = np.concatenate(residuals(found, every, substep_s))
    return Level(found, unknowns, solution.z, every, rms(r), 1.4826 * float(np.median(np.abs(r))))


def errors(model: Model, segments: Sequence[Segment], substep_s: float) -> FloatArray:
    """Root mean square of the residual of each segment (S,), in units of the noise."""
    return np.array([rms(r) for r in residuals(model, segments, substep_s)])


def are_missed(model: Model, segments: Sequence[Segment], substep_s: float) -> NDArray[np.bool_]:
    """Which segments of gears the model misses (S,): those whose error is several times that of the better ones.

    The cause is a wrong initial state.  None is missed of other bases, where the effect of the initial state decays, so
    that errors are those of the model.
    """
    return outliers(errors(model, segments, substep_s)) & (model.base == "play")


def followed_segments(level: Level, substep_s: float) -> list[Segment]:
    """The segments of a level that its model does not miss."""
    missed = are_missed(level.model, level.segments, substep_s)
    return [segment for segment, out in zip(level.segments, missed, strict=True) if not out]


def outliers(error: FloatArray) -> NDArray[np.bool_]:
    """Which errors (S,) exceed ``policy.MISSED`` times their 30 % quantile, or times the noise where that is larger."""
    return np.asarray(error > policy.MISSED * max(float(np.quantile(error, 0.3, method="lower")), 1.0))
