"""A run that is corrected at every sample, so that it follows a measurement.  No choice of gain or step here.

A free run of gears soon has its impacts at other times than the measurement; a corrected one does not, and how far it
is off at the next sample is a smooth function of the parameters (a Luenberger observer; Abarbanel, Creveling, Jeanne
2008, "Estimation of parameters in nonlinear systems using balanced synchronization").
"""

from __future__ import annotations

import math
from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from typing import Any, NamedTuple, cast

import numpy as np
from numba import njit
from numpy.typing import NDArray

from lostmotion.model.kernel import OPTIONS, compiled, jitted
from lostmotion.model.lanes import LANES, address, batches, offset
from lostmotion.model.motion import FloatArray, Motion
from lostmotion.model.pieces import Pieces, are_alike, cut
from lostmotion.model.rk4 import (
    IntArray,
    Plan,
    Pointer,
    Values,
    Work,
    advance,
    beside,
    equal_steps,
    in_lanes,
    lanes_for,
    memory,
    run,
    slopes_at,
    terms,
    work_for,
)

__all__ = ["UNLIMITED", "Budget", "Followed", "ObserverRun", "at_samples", "follow", "observer_input"]


class Budget(NamedTuple):
    """The loss of a run, the sum of log(1 + min((e/unit)², far)) over its samples from the ``first`` on, and the loss
    ``most`` above which it ends, (K,) or that of all; samples after that count with the largest loss, log(1 + far)."""

    first: int = 0
    unit: float = 1.0
    far: float = math.inf
    most: FloatArray | float = math.inf


UNLIMITED = Budget()
DIVERGED = 1e9
"""An innovation from which on a run is over."""


class Followed(NamedTuple):
    """Of K runs the innovation at each sample, e = measured - modelled (K, N), the states after gain e was added to
    them (K, N, n), and the losses (K,); see ``follow``.

    Innovations and states are infinite from where the motion diverges or the loss exceeds the budget.
    """

    e: FloatArray
    states: FloatArray
    loss: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class ObserverRun:
    """A model made ready to be run along a measurement.

    knots: (K + 1,) [s] from origin, with every sample among them; coefficients: (K + 1, 6) of the input's polynomials;
    at: (N,) which of the knots the samples are; reading: the signal that is measured.
    """

    plan: Plan
    knots: FloatArray
    coefficients: FloatArray
    at: IntArray
    origin: float
    reading: int

    def goes_beside(self, other: ObserverRun) -> bool:
        """Whether another run has the same terms, input, and distances between knots and samples."""
        return (
            self.plan.addresses is other.plan.addresses
            and self.reading == other.reading
            and are_alike(self.knots, other.knots)
            and _are_equal(self.coefficients, other.coefficients)
            and _are_equal(self.at, other.at)
        )


def _are_equal(one: NDArray[Any], other: NDArray[Any]) -> bool:
    return one is other or np.array_equal(one, other)


def follow(
    runs: Sequence[ObserverRun], starts: FloatArray, gains: FloatArray, measured: FloatArray, substep_s: float,
    budget: Budget = UNLIMITED, *, keeps: bool = True,
) -> Followed:  # fmt: skip
    """Runs along one measured signal (N,), each from a state and with gains of its own, (K, n) each; those that go
    beside each other are computed together.  keeps: whether innovations and states are wanted, else they are empty."""
    K, n = starts.shape
    N = measured.size if keeps else 0
    found = Followed(np.full((K, N), np.inf), np.full((K, N, n), np.inf), np.empty(K))
    most = np.broadcast_to(budget.most, K)
    left = list(range(K))
    while left:
        beside = [i for i in left if runs[i].goes_beside(runs[left[0]])]
        left = [i for i in left if i not in beside]
        for lanes in batches(len(beside)):
            which = beside[lanes]
            own = budget._replace(most=most[which])
            part = _follow_beside([runs[i] for i in which], starts[which], gains[which], measured, substep_s, own, N)
            found.e[which], found.states[which], found.loss[which] = part
    return found


def _follow_beside(
    runs: Sequence[ObserverRun], starts: FloatArray, gains: FloatArray, measured: FloatArray, substep_s: float,
    budget: Budget, N: int,
) -> Followed:  # fmt: skip
    """At most ``LANES`` runs that go beside each other; N: the number of innovations and states that are kept."""
    first, (K, n) = runs[0], starts.shape
    found = Followed(np.full((K, N), np.inf), np.full((K, N, n), np.inf), np.zeros(K))
    values = beside([run.plan for run in runs], [run.origin for run in runs])
    _follow(
        first.plan, values, first.knots, first.coefficients, first.at, substep_s, in_lanes([*gains]), first.reading,
        measured, found.e, found.states, work_for(first.plan, values, starts), *budget[:3], budget.most, found.loss,
    )  # fmt: skip
    return found


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


@jitted
def _judge(
    m: Any, w: Any, reading: int, measured: float, counts: bool, rest: int,
    unit: float, far: float, most: FloatArray, losses: FloatArray, is_over: Any,
) -> None:  # fmt: skip
    """Sets the innovations w.slope of a sample, zero in lanes that are over, and adds to the losses; rest: how many
    samples count from here on."""
    for k in range(most.size):
        error = measured - w.s[reading * LANES + k]
        loss = math.log1p(min((error / unit) ** 2, far)) if counts else 0.0
        if not is_over[k] and not (abs(error) < DIVERGED and losses[k] + loss <= most[k]):
            is_over[k], loss = True, rest * math.log1p(far)
            losses[k] += loss
        w.slope[k] = 0.0 if is_over[k] else error
        losses[k] += 0.0 if is_over[k] else loss


@jitted
def _keep(w: Any, x: Pointer, o: int, e: FloatArray, states: FloatArray, is_over: Any) -> None:
    """Writes innovations and states of sample o in the lanes that are not over, if they are wanted."""
    for k in range(is_over.size if e.shape[1] else 0):
        if not is_over[k]:
            e[k, o] = w.slope[k]
            for i in range(states.shape[2]):
                states[k, o, i] = x[i * LANES + k]


def _corrected(
    plan: Plan, values: Values, knots: FloatArray, coefficients: FloatArray, at: IntArray, substep: float,
    gain: FloatArray, reading: int, measured: FloatArray, e: FloatArray, states: FloatArray, work: Work,
    first: int, unit: float, far: float, most: FloatArray, losses: FloatArray,
) -> None:  # fmt: skip
    """See ``follow``; gain: (n x LANES,); e: (lanes, N) and states: (lanes, N, n), or (lanes, 0) and (lanes, 0, n);
    most: (lanes,); losses: (lanes,) zeros.  Writes e, states and losses."""
    m, w, polynomials, count = terms(plan, values), memory(work), address(coefficients, 0), most.size
    o, x, y, k1, k4 = 0, w.x, w.y, w.k1, w.k4
    end = lanes_for(count)
    is_over = np.zeros(count, dtype=np.bool_)
    for interval in range(knots.size):
        c, left = offset(polynomials, m.numbers * interval), knots[interval]
        if o < at.size and at[o] == interval:
            if interval == 0:  # later, the signals are those at the end of the step before
                slopes_at(m, w, c, left, x, k1, end)
            run(m, w, w.k, m.live, m.count, 0, end)
            _judge(m, w, reading, measured[o], o >= first, at.size - max(o, first), unit, far, most, losses, is_over)
            if is_over.all():
                break
            for at_state in range(0, m.states * LANES, LANES):
                for k in range(end):
                    x[at_state + k] += gain[at_state + k] * w.slope[k]
            _keep(w, x, o, e, states, is_over)
            o += 1
            slopes_at(m, w, c, left, x, k1, end)
        if o == at.size:
            break
        steps = equal_steps(knots[interval + 1] - left, substep)
        h = (knots[interval + 1] - left) / steps
        for step in range(steps):
            advance(m, w, c, left, x, k1, k4, y, step * h, h, end)
            x, y = y, x
            k1, k4 = k4, k1


_follow = compiled(partial(njit, nogil=True, **OPTIONS), _corrected)
