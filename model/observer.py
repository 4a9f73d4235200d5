"""A run that is corrected at every sample, so that it follows a measurement.  No choice of gain or step here.

A free run of gears soon has its impacts at other times than the measurement; a corrected one does not, and how far it
is off at the next sample is a smooth function of the parameters (a Luenberger observer; Abarbanel, Creveling, Jeanne
2008, "Estimation of parameters in nonlinear systems using balanced synchronization").
"""

from __future__ import annotations

import math
from collections.abc import Hashable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple, cast

import numpy as np
from numba import njit

from lostmotion.model.kernel import OPTIONS, compiled
from lostmotion.model.lanes import LANES, address, offset
from lostmotion.model.motion import FloatArray, Motion
from lostmotion.model.pieces import Pieces, cut
from lostmotion.model.rk4 import (
    IntArray,
    Plan,
    Values,
    Work,
    beside,
    inputs,
    load,
    memory,
    rates,
    rk4_of_one,
    run,
    terms,
    work_for,
)

__all__ = ["Budget", "ObserverRun", "at_samples", "observer_input"]


class Budget(NamedTuple):
    """The loss of a run, the sum of log(1 + min((e/unit)², far)) over its samples from the ``first`` on, and the loss
    ``most`` above which the run ends; samples after that count with the largest loss, log(1 + far)."""

    first: int = 0
    unit: float = 1.0
    far: float = math.inf
    most: float = math.inf


UNLIMITED = Budget()


@dataclass(frozen=True, slots=True, eq=False)
class ObserverRun:
    """Calling it with a start state (n,), gains (n,), the measured signal (N,) and a sub-step [s] gives the innovation
    at each sample, e = measured - modelled (N,), the states after gain e was added to them (N, n), and the loss of the
    run (see Budget).

    Innovations and states are infinite from where the motion diverges or the loss exceeds the budget.  knots:
    (K + 1,) [s] from origin, with every sample among them; at: (N,) which of them the samples are; reading: the signal
    that is measured.
    """

    plan: Plan
    knots: FloatArray
    coefficients: FloatArray
    at: IntArray
    origin: float
    reading: int

    def __call__(
        self, start: FloatArray, gain: FloatArray, measured: FloatArray, substep_s: float, budget: Budget = UNLIMITED
    ) -> tuple[FloatArray, FloatArray, float]:
        e, states = np.full(self.at.size, np.inf), np.full((self.at.size, start.size), np.inf)
        values = beside([self.plan], [self.origin])
        work = work_for(self.plan, values, start[None])
        loss = _follow(self.plan, values, self.knots, self.coefficients, self.at, substep_s, gain, self.reading,
                       measured, e, states, work, *budget)  # fmt: skip
        return e, states, float(loss)


def observer_input(
    drive: Motion | None, origin: float, times: FloatArray, delay: float
) -> tuple[FloatArray, FloatArray, IntArray]:
    """Knots, coefficients and which knots the samples are; times: (N,) from origin [s], the first of them 0."""
    return _cut_at(cast(Hashable, drive), origin, times.tobytes(), delay)


@lru_cache(maxsize=128)  # a search asks for the same stretches thousands of times
def _cut_at(drive: Any, origin: float, times: bytes, delay: float) -> tuple[FloatArray, FloatArray, IntArray]:
    grid = np.frombuffer(times)
    knots, coefficients = at_samples(cut(drive, origin, max(float(grid[-1]), 1e-3), delay), grid)
    return knots, coefficients, np.searchsorted(knots, grid - 1e-9).astype(np.int64)


def at_samples(pieces: Pieces, times: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The input's polynomials cut so that every sample is a knot: knots (K + 1,), coefficients (K + 1, 6)."""
    knots = np.union1d(pieces.knots, times)
    apart = np.concatenate(([True], np.diff(knots) > 1e-9))  # a knot that is a sample up to rounding
    knots = knots[apart]
    piece = np.clip(np.searchsorted(pieces.knots, knots + 1e-9, "right") - 1, 0, len(pieces.coefficients) - 1)
    shift, c = knots - pieces.knots[piece], pieces.coefficients[piece]
    moved = np.zeros_like(c)
    binomials = [[1], [1, 1], [1, 2, 1], [1, 3, 3, 1], [1, 4, 6, 4, 1], [1, 5, 10, 10, 5, 1]]
    for power, row in enumerate(binomials):
        for order, factor in enumerate(row):
            moved[:, order] += c[:, power] * factor * shift ** (power - order)
    return knots, moved


def _corrected(
    plan: Plan, values: Values, knots: FloatArray, coefficients: FloatArray, at: IntArray, substep: float,
    gain: FloatArray, reading: int, measured: FloatArray, e: FloatArray, states: FloatArray, work: Work,
    first: int, unit: float, far: float, most: float,
) -> float:  # fmt: skip
    """See ObserverRun; writes e and states, and returns the loss."""
    m, w, polynomials, spent = terms(plan, values), memory(work), address(coefficients, 0), 0.0
    n, o, x, y, k1, k4 = m.states, 0, w.x, w.y, w.k1, w.k4
    for interval in range(knots.size):
        c, left = offset(polynomials, m.numbers * interval), knots[interval]
        if o < at.size and at[o] == interval:
            inputs(m, w, c, left, w.none, 0.0, w.none, 0, 1)
            load(m, w, x, k1, 0.0, w.none, 0, 1)
            rates(m, w, k1, 0, 1)
            run(m, w, w.k, m.live, m.count, 0, 1)
            error = measured[o] - w.s[reading * LANES]
            loss = math.log1p(min((error / unit) ** 2, far)) if o >= first else 0.0
            if not (abs(error) < 1e9 and spent + loss <= most):
                return spent + (at.size - max(o, first)) * math.log1p(far)
            spent += loss
            e[o] = error
            for i in range(n):
                x[i * LANES] += gain[i] * error
                states[o, i] = x[i * LANES]
            o += 1
            load(m, w, x, k1, 0.0, w.none, 0, 1)
            rates(m, w, k1, 0, 1)
        if o == at.size:
            break
        steps = max(1, int(np.ceil((knots[interval + 1] - left) / substep - 1e-9)))
        w.h[0] = (knots[interval + 1] - left) / steps
        for step in range(steps):
            w.since[0] = step * w.h[0]
            rk4_of_one(m, w, c, left, x, k1, k4, y, 0)
            x, y = y, x
            k1, k4 = k4, k1
    return spent


_follow = compiled(lambda **options: njit(nogil=True, **OPTIONS, **options)(_corrected))
