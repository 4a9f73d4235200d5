"""A model made ready to be run many times over the same input and times: what a fit does.  No choice of step here."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lostmotion.model.motion import FloatArray
from lostmotion.model.pieces import Pieces
from lostmotion.model.solve import IntArray, Plan, integrate_many

__all__ = ["Run"]


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
        out = np.empty((len(starts), self.records.size, self.grid.size))
        knots, coefficients = self.pieces.knots, self.pieces.coefficients
        integrate_many(self.plan, knots, coefficients, substep_s, starts, self.grid, self.records, out, self.origin)
        return out if self.picks is None else np.take_along_axis(out, self.picks[None], axis=2)
