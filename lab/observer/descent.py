"""Local minimisation of the prediction error of observers.

With a high gain the prediction error is nearly linear in the parameters, so that a curve with a dozen values can be
fitted from zero, together with the play (discrepancy/describe.py).  The global search (global_search.py) is for few
parameters and distant initial values, and ends with these steps.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from lostmotion.lab.deadline import is_over
from lostmotion.lab.observer.filter import STRONG
from lostmotion.lab.observer.objective import OUTSIDE, Follower
from lostmotion.lab.shooting.parameters import Unknowns
from lostmotion.model import Model
from lostmotion.model.motion import FloatArray

__all__ = ["Descent"]

STEP = 1e-4
"""Step of the finite differences, in z.  A tenth and ten times of it change none of twelve minima of two searches
(pairs of seeds 912 and 6100, the low gain) by more than 3 %."""
STEPS, TRIALS = 15, 6
"""Largest number of steps, and of dampings that are tried in one.  With 8 and 30 steps these minima differ by at most
5 %, in 0.7 and 1.4 times the time; with 3 trials one of them differs by 3 %, with 12 none."""
ENOUGH = 3e-4
"""Least share by which a step has to lower the cost to be followed by another one.  With ten times as much these minima
differ by at most 6 %, in 0.6 of the time, with a tenth by at most 2 %."""


@dataclass(frozen=True, eq=False)
class Descent:
    """A local minimum of the cost, the mean of log(1 + (e/OUTSIDE)²) over innovations e in units of their expected
    deviation, over the free parameters of a model."""

    model: Model
    cost: float

    @classmethod
    def of(cls, model: Model, follower: Follower, coupling: float = STRONG) -> Descent:
        """The minimum that Levenberg-Marquardt steps from the values of a model lead to; coupling: of the observers."""
        unknowns = Unknowns.of(model, follower.rough)
        z, (low, high) = unknowns.z(model), unknowns.bounds
        (e,), damping = follower.errors([model], coupling), 1e-2
        cost = _cost(e)
        for _ in range(STEPS):
            if is_over() or not math.isfinite(cost):
                break
            moved = follower.errors([unknowns.put(model, z + step) for step in STEP * np.eye(z.size)], coupling)
            J, w = (moved.T - e[:, None]) / STEP, 1 / (1 + (e / OUTSIDE) ** 2)
            if not np.isfinite(J).all():
                break
            H, g = (J * w[:, None]).T @ J + np.diag(1 / unknowns.prior**2), (J * w[:, None]).T @ e
            before = cost
            for _ in range(TRIALS):
                dz = np.linalg.solve(H + damping * np.diag(np.diag(H)), -g)
                there = np.clip(z + np.clip(dz, -2.0, 2.0), low, high)
                (tried,) = follower.errors([unknowns.put(model, there)], coupling)
                if _cost(tried) < cost:
                    z, e, cost, damping = there, tried, _cost(tried), damping / 8
                    break
                damping *= 6
            if before - cost <= ENOUGH * before:
                break
        return cls(unknowns.put(model, z), cost)


def _cost(e: FloatArray) -> float:
    return float(np.mean(np.log1p((e / OUTSIDE) ** 2)))
