"""A model made ready to be run many times over the same input and times: what a fit does.  No choice of step here."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from lostmotion.model.motion import FloatArray
from lostmotion.model.pieces import Pieces, are_alike
from lostmotion.model.rk4 import IntArray, Plan
from lostmotion.model.solve import solve

__all__ = ["Run", "from_first", "records", "run_beside", "run_each"]


@dataclass(frozen=True, slots=True, eq=False)
class Run:
    """Calling it with start states (K, n) and a sub-step [s] gives the outputs (K, outputs, N).

    They are not finite where the motion exceeds all numbers; nothing is checked.  grid: the times that are integrated;
    timing: delay of the input [s] and rate of the sensor's clock; picks: which of the times each output shows,
    (outputs, N), or None for all in order.
    """

    plan: Plan
    pieces: Pieces
    grid: FloatArray
    origin: float
    records: IntArray
    timing: tuple[float, float]
    picks: IntArray | None = None

    def __call__(self, starts: FloatArray, substep_s: float) -> FloatArray:
        return run_beside([self], starts, substep_s)

    def goes_beside(self, other: Run) -> bool:
        """Whether another run has the same terms and outputs, and knots and times at the same distances; none of a
        sensor with a clock of its own."""
        if self.plan.addresses is not other.plan.addresses or self.picks is not other.picks:
            return False
        if self.timing != other.timing:  # by less than the rounding of times, where a derivative is taken by them
            return False
        return (
            self.records is other.records
            and are_alike(self.pieces.knots, other.pieces.knots)
            and are_alike(self.grid, other.grid)
        )


@lru_cache(maxsize=256)  # a fit asks for the same times and outputs thousands of times
def from_first(times: bytes) -> tuple[float, FloatArray]:
    """The first of times (N,), given as bytes, and all times from there on."""
    every = np.frombuffer(times)
    return float(every[0]), every - every[0]


@lru_cache(maxsize=256)
def records(signals: tuple[int, ...]) -> IntArray:
    """The numbers of signals, always the same array."""
    return np.array(signals, dtype=np.int64)


def run_each(runs: Sequence[Run | None], starts: FloatArray, substep_s: float) -> list[FloatArray | None]:
    """The outputs (outputs, N) of each run from its state, starts (K, n); None stays None.  Runs that go beside each
    other are computed together."""
    found: list[FloatArray | None] = [None] * len(runs)
    left = {id(run): run for run in runs if run is not None}
    while left:
        first = next(iter(left.values()))
        beside = {key for key, run in left.items() if run.goes_beside(first)}
        at = [i for i, run in enumerate(runs) if id(run) in beside]
        which = [run for i in at if (run := runs[i]) is not None]
        for i, out in zip(at, run_beside(which, starts[at], substep_s), strict=True):
            found[i] = out
        left = {key: run for key, run in left.items() if key not in beside}
    return found


def run_beside(runs: Sequence[Run], starts: FloatArray, substep_s: float) -> FloatArray:
    """The outputs (K, outputs, N) of runs that go beside each other, from a state (K, n) each, or of one run from all
    of these states; see ``Run``."""
    first, plans, inputs = runs[0], [run.plan for run in runs], [run.pieces for run in runs]
    origins = [run.origin for run in runs]
    if all(_are_equal(one, inputs[0]) for one in inputs[1:]):
        inputs = inputs[:1]
    out, *_ = solve(plans, inputs, substep_s, starts, first.grid, first.records, origins)
    return out if first.picks is None else np.take_along_axis(out, first.picks[None], axis=2)


def _are_equal(one: Pieces, other: Pieces) -> bool:
    return one is other or np.array_equal(one.coefficients, other.coefficients)
