"""A model made ready to be run many times over the same input and times: what a fit does.  No choice of step here."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lostmotion.model.motion import FloatArray
from lostmotion.model.pieces import Pieces
from lostmotion.model.rk4 import IntArray, Plan
from lostmotion.model.solve import solve

__all__ = ["Run", "run_beside", "run_each"]


@dataclass(frozen=True, slots=True, eq=False)
class Run:
    """Calling it with start states (K, n) and a sub-step [s] gives the outputs (K, outputs, N).

    They are not finite where the motion exceeds all numbers; nothing is checked.  grid: the times that are integrated;
    picks: which of them each output shows, (outputs, N), or None for all in order.
    """

    plan: Plan
    pieces: Pieces
    grid: FloatArray
    origin: float
    records: IntArray
    picks: IntArray | None = None

    def __call__(self, starts: FloatArray, substep_s: float) -> FloatArray:
        return run_beside([self], starts, substep_s)

    def goes_beside(self, other: Run | None) -> bool:
        """Whether another run has the same terms, input and times."""
        if other is None:
            return False
        own, its = self.pieces, other.pieces
        is_same_input = own is its or (
            np.array_equal(own.knots, its.knots) and np.array_equal(own.coefficients, its.coefficients)
        )
        is_same_time = self.origin == other.origin and np.array_equal(self.grid, other.grid)
        return self.plan.addresses is other.plan.addresses and is_same_input and is_same_time


def run_each(runs: Sequence[Run | None], starts: FloatArray, substep_s: float) -> list[FloatArray | None]:
    """The outputs (outputs, N) of each run from its state, starts (K, n); None stays None.  Runs that go beside each
    other are computed together."""
    found: list[FloatArray | None] = [None] * len(runs)
    left = [i for i, run in enumerate(runs) if run is not None]
    while left:
        beside = {i: run for i in left if (run := runs[i]) is not None and run.goes_beside(runs[left[0]])}
        for i, out in zip(beside, run_beside([*beside.values()], starts[[*beside]], substep_s), strict=True):
            found[i] = out
        left = [i for i in left if i not in beside]
    return found


def run_beside(runs: Sequence[Run], starts: FloatArray, substep_s: float) -> FloatArray:
    """The outputs (K, outputs, N) of runs that go beside each other, from a state (K, n) each, or of one run from all
    of these states; see ``Run``."""
    first, plans = runs[0], [run.plan for run in runs]
    knots, coefficients = first.pieces.knots, first.pieces.coefficients
    out, *_ = solve(plans, knots, coefficients, substep_s, starts, first.grid, first.records, first.origin)
    return out if first.picks is None else np.take_along_axis(out, first.picks[None], axis=2)
