"""Levenberg-Marquardt for segments with shared parameters and separate initial states.

The start states are eliminated segment by segment (Schur complement), so ten segments cost little more than one.
Residuals count in units of the noise; large ones count by their magnitude only (Huber), so that one impact at the wrong
time does not dominate the fit.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lostmotion.lab.deadline import is_over
from lostmotion.lab.shooting.parameters import Unknowns
from lostmotion.lab.shooting.segment import Linearised, Segment
from lostmotion.model import Model, ModelError
from lostmotion.model.motion import FloatArray

__all__ = ["Solution", "minimise", "projected_off", "robust"]

START_PRIOR = 20.0
"""Standard deviation of the prior on an initial state, in its scale, around its first value."""
TRIALS = 6
EDGES = 0.5
"""Share of the segments with an increased cost, above which a step is rejected."""


@dataclass(frozen=True, eq=False)
class Solution:
    """Parameters z (P,), the segments with their start states, and the robust cost (half the sum of squares where
    nothing lies outside)."""

    z: FloatArray
    segments: tuple[Segment, ...]
    cost: float


@dataclass(frozen=True, eq=False)
class Problem:
    """model: the values of fixed parameters; huber: bound of Huber's cost, in units of the noise."""

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
        found = np.empty(len(segments))
        for at, s in enumerate(segments):
            found[at] = robust(s.residual(s.experiment.model(model), s.start, self.substep_s), self.huber)
        return found

    def moved(
        self, z: FloatArray, segments: Sequence[Segment], ds: Sequence[FloatArray], before: FloatArray
    ) -> tuple[tuple[Segment, ...], FloatArray]:
        """The segments at other parameters with changed initial states, and their costs (S,).

        A few segments with an increased cost keep their initial states, if that is better: one initial state near an
        impact must not block the others.  With many of them the step is too long.  before: (S,) their costs.
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
    """Improves z and the start states until the cost falls by less than ``tolerance`` of itself.

    Never returns anything worse than it was given; when the time is up, returns the best so far.
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
    """The damped Gauss-Newton step of parameters (P,) and of each start state (n,), in their scales."""
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
    return np.ones_like(r) if math.isinf(huber) else 1 / np.maximum(1.0, np.abs(r) / huber)


def robust(r: FloatArray, huber: float) -> FloatArray:
    """Huber's cost of residuals (…, M): half the sum of squares within the bound."""
    size = np.abs(r)
    inside = 0.5 * np.minimum(size, huber) ** 2
    cost = inside if math.isinf(huber) else np.where(size <= huber, inside, huber * (size - huber / 2))
    return np.asarray(np.sum(cost, axis=-1))


def projected_off(columns: FloatArray, values: FloatArray) -> FloatArray:
    """The projection of values (M,) or (M, K) onto the orthogonal complement of the columns (M, P)."""
    q = np.linalg.qr(columns)[0]
    return np.asarray(values - q @ (q.T @ values))
