"""The Levenberg-Marquardt method for segments with shared parameters and an initial state each.

The initial states are eliminated segment by segment (Schur complement), so that the cost of a step is linear in the
number of segments.  Residuals are in units of the noise, with Huber's cost, so that one impact at the wrong time does
not dominate the fit.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lostmotion.lab.deadline import is_over
from lostmotion.lab.shooting.parameters import Unknowns
from lostmotion.lab.shooting.segment import Linearised, Segment, residuals
from lostmotion.model import Model, ModelError
from lostmotion.model.motion import FloatArray

__all__ = ["Solution", "minimise", "projected_off", "robust"]

START_PRIOR = 20.0
"""Standard deviation of the prior on an initial state around its first value, in units of its scale."""
TRIALS = 6
"""Largest number of dampings that are tried in a step."""
EDGES = 0.5
"""Share of the segments with an increased cost from which on a step is too long."""


@dataclass(frozen=True, eq=False)
class Solution:
    """The result of a minimisation: the parameters z (P,), the segments with their initial states, and the cost."""

    z: FloatArray
    segments: tuple[Segment, ...]
    cost: float


@dataclass(frozen=True, eq=False)
class Problem:
    """What is minimised over z and the initial states: the sum of Huber's costs of all residuals, and of the priors.

    model: has the values of fixed parameters; huber: bound of Huber's cost, in units of the noise; infinite for
    squares.
    """

    model: Model
    unknowns: Unknowns
    centre: FloatArray
    """(P,) the means of the priors."""
    substep_s: float
    huber: float = math.inf

    def prior(self, z: FloatArray) -> float:
        """The cost of the priors on the parameters."""
        return 0.5 * float(np.sum(((z - self.centre) / self.unknowns.prior) ** 2))

    def costs(self, z: FloatArray, segments: Sequence[Segment]) -> FloatArray:
        """Robust cost of each segment (S,); infinite where the model cannot be run."""
        try:
            model = self.unknowns.put(self.model, z)
        except ModelError:
            return np.full(len(segments), np.inf)
        return np.array([robust(r, self.huber) for r in residuals(model, segments, self.substep_s)])

    def moved(
        self, z: FloatArray, segments: Sequence[Segment], ds: Sequence[FloatArray], before: FloatArray
    ) -> tuple[tuple[Segment, ...], FloatArray]:
        """The segments at the parameters z, with initial states that are changed by ds (units of their scales), and
        their costs (S,); before: their costs at the present parameters (S,).

        Where the costs of few segments increase, these keep their initial states if that is better, as one initial
        state near an impact must not block the others.
        """
        there = [s.starting(s.start + s.scale * d) for s, d in zip(segments, ds, strict=True)]
        costs = self.costs(z, there)
        worse = np.flatnonzero(~(costs < before)).tolist()
        if len(worse) >= EDGES * len(there):
            return tuple(there), costs
        for i, stayed in zip(worse, self.costs(z, [segments[i] for i in worse]), strict=True):
            if stayed < costs[i]:
                there[i], costs[i] = segments[i], stayed
        return tuple(there), costs


def minimise(
    problem: Problem,
    z: FloatArray,
    segments: Sequence[Segment],
    *,
    iterations: int = 20,
    tolerance: float = 1e-4,
) -> Solution:
    """Minimises the cost over the parameters z (P,) and the initial states, from these values.

    Ends after so many iterations, when a step lowers the cost by less than ``tolerance`` of it, or when the time is up.
    The result is never worse than the initial values.
    """
    z, segments = z.copy(), tuple(segments)
    low, high = problem.unknowns.bounds
    home = [segment.start for segment in segments]
    costs = problem.costs(z, segments)
    cost, damping = problem.prior(z) + float(costs.sum()), 1e-3
    for _ in range(iterations):
        if is_over() or not math.isfinite(cost):
            break
        blocks = [one.linearised(problem.model, problem.unknowns, z, problem.substep_s) for one in segments]
        if not all(block.finite for block in blocks):
            break
        pull = [(s.start - h) / s.scale / START_PRIOR**2 for s, h in zip(segments, home, strict=True)]
        before = cost
        for _ in range(TRIALS):
            dz, ds = _step(problem, z, blocks, pull, damping, (low, high))
            new_z = np.clip(z + dz, low, high)
            there, new_costs = problem.moved(new_z, segments, ds, costs)
            new_cost = problem.prior(new_z) + float(new_costs.sum())
            if new_cost < cost:
                z, segments, costs, cost, damping = new_z, there, new_costs, new_cost, max(damping / 8, 1e-9)
                break
            damping = max(damping * 6, 1e-6)
        if before - cost <= tolerance * before:
            break
    return Solution(z, segments, cost)


def _step(
    problem: Problem,
    z: FloatArray,
    blocks: Sequence[Linearised],
    pull: Sequence[FloatArray],
    damping: float,
    bounds: tuple[FloatArray, FloatArray],
) -> tuple[FloatArray, list[FloatArray]]:
    """The damped Gauss-Newton step of z (P,) and of each initial state (n,) in units of its scale; pull: the gradients
    of the priors on the initial states."""
    weight = 1 / problem.unknowns.prior**2
    H, g = np.diag(weight), weight * (z - problem.centre)
    eliminated = []
    for block, home in zip(blocks, pull, strict=True):
        w = _weights(block.r, problem.huber)[:, None]
        A, B = block.A * w, block.B * w
        H += A.T @ block.A
        g += A.T @ block.r
        S = B.T @ block.B + np.eye(B.shape[1]) / START_PRIOR**2
        S[np.diag_indices_from(S)] *= 1 + damping
        eliminated.append((np.linalg.inv(S), A.T @ block.B, B.T @ block.r + home))
    H[np.diag_indices_from(H)] *= 1 + damping
    for S_inverse, K, gs in eliminated:
        H -= K @ S_inverse @ K.T
        g -= K @ S_inverse @ gs
    low, high = bounds
    stuck = ((z <= low) & (g > 0)) | ((z >= high) & (g < 0))
    free = np.flatnonzero(~stuck)
    dz = np.zeros(z.size)
    if free.size:
        dz[free] = np.linalg.lstsq(H[np.ix_(free, free)], -g[free], rcond=1e-14)[0]
    dz = np.clip(dz, -2.0, 2.0)
    return dz, [-S_inverse @ (gs + K.T @ dz) for S_inverse, K, gs in eliminated]


def _weights(r: FloatArray, huber: float) -> FloatArray:
    """The weights of residuals (M,) in a step: 1 within Huber's bound, huber/|r| beyond."""
    return np.ones_like(r) if math.isinf(huber) else 1 / np.maximum(1.0, np.abs(r) / huber)


def robust(r: FloatArray, huber: float) -> FloatArray:
    """Huber's cost of residuals (…, M), summed over the last axis: r²/2 within the bound, huber (|r| - huber/2)
    beyond."""
    size = np.abs(r)
    inside = 0.5 * np.minimum(size, huber) ** 2
    cost = inside if math.isinf(huber) else np.where(size <= huber, inside, huber * (size - huber / 2))
    return np.asarray(np.sum(cost, axis=-1))


def projected_off(columns: FloatArray, values: FloatArray) -> FloatArray:
    """The projection of values (M,) or (M, K) onto the orthogonal complement of the columns (M, P)."""
    q = np.linalg.qr(columns)[0]
    return np.asarray(values - q @ (q.T @ values))
