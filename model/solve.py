"""The compiled integrator: fixed-step RK4 over a list of terms given by address.  It knows no physics.

Time runs over the intervals of the input's polynomial; each is cut into steps no longer than asked for, so no step
straddles a knot.  Output times are free: between steps the states follow the cubic Hermite polynomial through both
ends (fourth order, as the steps are), and all signals are evaluated from them.  Only where the speed passes through the
width in which dry friction changes its sign are steps halved, as often as the slope of the acceleration there needs.
Outside of it the motion is smooth and a step is exact to a thousandth of a millionth, whichever is taken: the result is
a smooth function of the parameters, and finite differences of it make sense.

Several runs go side by side, one in each lane (rk4.py).  Each is what it would be alone: a lane whose steps are halved
takes its own parts of the step while the others wait.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numba import njit

from lostmotion.model.kernel import OPTIONS, compiled, jitted, subroutine
from lostmotion.model.lanes import LANES, address, batches, offset
from lostmotion.model.pieces import Pieces
from lostmotion.model.rk4 import (
    FloatArray,
    IntArray,
    Plan,
    Pointer,
    Values,
    Work,
    advance,
    beside,
    equal_steps,
    inputs,
    lanes_for,
    load,
    memory,
    rates,
    rk4,
    rk4_of_one,
    run,
    slopes_at,
    terms,
    work_for,
)

__all__ = ["SPEED", "integrate", "solve", "start_signals"]

T = TypeVar("T")

SPEED = 1
"""The state that dry friction opposes: the second one of every base."""
LAYER_STEP = 1.0
"""Step times the slope of the acceleration within the layer.  RK4 is stable to about 2.8; a pendulum that dry friction
stops is off by 1e-5, 4e-5 and 2e-4 rad with 0.5, 1 and 2 (docs/decisions/0001)."""
MOST_HALVINGS = 12
"""Down to 1 us of 4 ms.  A guess with a friction so large that this is too long is far off: its speed then swings by
the friction's acceleration times the step."""
CREEP = 0.1
"""Largest change of the speed in a step of a joint that friction holds, in widths of the change of sign: a servo that
holds a weight for much of 6 s is off by 7e-7 rad (docs/decisions/0001)."""


class Parts(NamedTuple):
    """The parts of a step that each lane takes on its own, (LANES,) each: units: in how many it is cut; done: how many
    are behind; size: of the next part, in units; is_new: whether its size has to be chosen; creeps: see ``_creep``;
    next: number of the next output."""

    units: IntArray
    done: IntArray
    size: IntArray
    is_new: IntArray
    creeps: IntArray
    next: IntArray

    @classmethod
    def empty(cls) -> Parts:
        """The memory of a run."""
        return cls(*np.empty((6, LANES), dtype=np.int64))


@jitted
def _part_pointers(parts: Parts) -> Any:
    """The same as pointers to the first number of each array."""
    return Parts(
        address(parts.units, 0), address(parts.done, 0), address(parts.size, 0), address(parts.is_new, 0),
        address(parts.creeps, 0), address(parts.next, 0),
    )  # fmt: skip


@subroutine
def _speed_rate(m: Any, w: Any, c: Pointer, left: float, part: float, z: Pointer, one: int) -> float:
    """The acceleration of a lane with the states z at a part of its step; its derivatives are left in w.k."""
    inputs(m, w, c, left, w.since, part, w.h, one, one + 1)
    load(m, w, z, w.k, 0.0, w.h, one, one + 1)
    rates(m, w, w.k, one, one + 1)
    return float(w.k[SPEED * LANES + one])


@jitted
def _slope(m: Any, w: Any, c: Pointer, left: float, x: Pointer, one: int) -> float:
    """Fall of the acceleration of a lane over the narrowest change of sign of a dry friction [1/s]: its reciprocal is
    the time in which the friction stops the joint there.  z and k are overwritten."""
    width, at = m.sharpest[one], SPEED * LANES + one
    for i in range(m.states):
        w.z[i * LANES + one] = x[i * LANES + one]
    w.z[at] = -0.5 * width
    across = _speed_rate(m, w, c, left, 0.0, w.z, one)
    w.z[at] = 0.5 * width
    return float((across - _speed_rate(m, w, c, left, 0.0, w.z, one)) / width)


@jitted
def _halvings(stiffness: float) -> int:
    """How often a step of this length, times the slope, is halved until it is ``LAYER_STEP``."""
    halvings = 0
    while stiffness > LAYER_STEP and halvings < MOST_HALVINGS:
        stiffness, halvings = stiffness / 2, halvings + 1
    return halvings


@jitted
def _creep(m: Any, w: Any, c: Pointer, left: float, x: Pointer, k1: Pointer, one: int) -> bool:
    """One exponential Rosenbrock-Euler step of a joint that friction holds, in one lane, from x with slopes k1 to the
    states z with slopes k, both useless where it returns False: where the joint does not creep, or is not stiff.  A lag
    that has a state of its own takes a midpoint step.

    omega(t) = omega + a (1 - exp(-lambda t))/lambda, with the acceleration a and its slope lambda in the middle of the
    step (Hochbruck and Ostermann, Exponential integrators, Acta Numerica 2010).
    """
    h, width, at, n = w.h[one], m.sharpest[one], SPEED * LANES + one, m.states
    w.z[one], w.z[at] = x[one] + h / 2 * x[at], x[at]
    for i in range(SPEED + 1, n):
        w.z[i * LANES + one] = x[i * LANES + one] + h / 2 * k1[i * LANES + one]
    acceleration = _speed_rate(m, w, c, left, 0.5, w.z, one)
    own = w.k[(SPEED + 1) * LANES + one]  # of the lag, where n is 3
    w.z[at] += CREEP * width
    slope = (acceleration - _speed_rate(m, w, c, left, 0.5, w.z, one)) / (CREEP * width)
    if not h * slope > LAYER_STEP:
        return False
    gained = acceleration * (1 - np.exp(-h * slope)) / slope
    if not abs(gained) < CREEP * width:
        return False
    w.z[one], w.z[at] = x[one] + h * x[at] + (h * acceleration - gained) / slope, x[at] + gained
    for i in range(SPEED + 1, n):
        w.z[i * LANES + one] = x[i * LANES + one] + h * own
    _speed_rate(m, w, c, left, 1.0, w.z, one)
    return True


@jitted
def _passes(speed: float, acceleration: float, h: float, layer: float) -> bool:
    """Whether the speed comes within the layer about zero in the next h [s]."""
    end = speed + h * acceleration
    return min(abs(speed), abs(end)) < layer or speed * end < 0.0


@subroutine
def _evaluate(m: Any, w: Any, c: Pointer, left: float, since: float, z: Pointer, first: int, end: int) -> None:
    """All signals of the lanes first … end - 1 for the states z, ``since`` [s] after a knot."""
    for k in range(first, end):
        w.since[k] = since
    inputs(m, w, c, left, w.since, 0.0, w.none, first, end)
    load(m, w, z, w.k, 0.0, w.none, first, end)
    run(m, w, w.k, 0, m.live, first, end)


@subroutine
def _hermite(
    n: int, w: Any, x: Pointer, k1: Pointer, y: Pointer, k4: Pointer, h: float, part: float, first: int, end: int
) -> None:
    """z = the cubic through (x, k1) and (y, k4), h apart, at this part of h."""
    rest = 1.0 - part
    for i in range(n):
        at = i * LANES
        for k in range(first, end):
            ends = rest * x[at + k] + part * y[at + k]
            slope = y[at + k] - x[at + k]
            bent = (rest - part) * slope - h * (rest * k1[at + k] - part * k4[at + k])
            w.z[at + k] = ends - part * rest * bent


@subroutine
def _keep(
    m: Any, w: Any, z: Pointer, records: IntArray, out: Any, states: Any, o: int, first: int,
    end: int, count: int,
) -> None:  # fmt: skip
    """Evaluates the terms that only outputs need, and writes sample o of the lanes first … end - 1, of which those from
    ``count`` on are not asked for; z: the states."""
    run(m, w, w.k, m.live, m.count, first, end)
    for k in range(first, min(end, count)):
        for r in range(records.size):
            out[k, r, o] = w.s[records[r] * LANES + k]
        for i in range(states.shape[2]):
            states[k, o, i] = z[i * LANES + k]


@jitted
def _begin(
    m: Any, w: Any, c: Pointer, left: float, x: Pointer, k1: Pointer, step_s: float, since: float,
    parts: Any, o: int, count: int,
) -> None:  # fmt: skip
    """Cuts a step of the lanes 0 … count - 1 in as many units as the friction of each needs."""
    for k in range(count):
        parts.done[k], parts.units[k], w.slope[k], at = 0, 1, 0.0, SPEED * LANES + k
        if m.layer[k] > 0.0 and _passes(x[at], k1[at], step_s, m.layer[k]):
            w.since[k], w.h[k] = since, step_s
            w.slope[k] = _slope(m, w, c, left, x, k)
            parts.units[k] = 1 << _halvings(step_s * w.slope[k])
        parts.size[k], parts.is_new[k], parts.next[k] = parts.units[k], 1, o


@jitted
def _choose(
    m: Any, w: Any, c: Pointer, left: float, x: Pointer, k1: Pointer, step_s: float, since: float,
    parts: Any, count: int,
) -> tuple[bool, int, int]:  # fmt: skip
    """Chooses the next part of the step of each lane that is not at its end: since, h, and whether it creeps.  Returns
    whether there is one, and the first and the last lane that take a Runge-Kutta step."""
    moves, first, last = False, LANES, -1
    for k in range(count):
        units, done, layer, at = parts.units[k], parts.done[k], m.layer[k], SPEED * LANES + k
        parts.creeps[k], w.h[k] = 0, 0.0
        w.since[k] = since + done / units * step_s
        if done == units:
            continue
        size = parts.size[k]
        if parts.is_new[k]:
            if done > 0:
                size = done & -done  # so that parts of each size begin at multiples of it
            may_creep = m.states <= 3 and abs(k1[at]) < CREEP * m.sharpest[k] * w.slope[k]
            while size > 1 and _passes(x[at], k1[at], step_s * size / units, layer):
                w.h[k] = step_s * size / units
                if may_creep and _creep(m, w, c, left, x, k1, k):
                    parts.creeps[k] = 1
                    break
                size >>= 1
        parts.size[k], w.h[k] = size, step_s * size / units
        moves = True
        if not parts.creeps[k]:
            first, last = min(first, k), k
    return moves, first, last


@jitted
def _cut(knots: FloatArray, interval: int, substep: float) -> tuple[int, float, float, float]:
    """The number of steps in an interval, and the lengths of the first one, of those between, and of the last one.

    They are equal, but in the first and the last interval, which a delay of the input lengthens and shortens.  The
    steps of the next interval are taken there, and what these leave comes at the outer end: it may vanish, so the
    motion is continuous in the delay.  With equal steps, whose number changes where a delay is a multiple of them, the
    motion jumped by 2e-6 rad, and the interval of a servo's delay was 74.0000 ± 0.0002 instead of 74 ± 5 ms.
    """
    length, intervals = knots[interval + 1] - knots[interval], knots.size - 1
    steps = equal_steps(length, substep)
    h = length / steps
    if intervals < 3 or 0 < interval < intervals - 1:
        return steps, h, h, h
    beside = knots[2] - knots[1] if interval == 0 else knots[interval] - knots[interval - 1]
    if abs(beside - length) < 1e-9 * length:
        return steps, h, h, h
    whole = beside / equal_steps(beside, substep)
    steps = equal_steps(length, whole)
    rest = length - (steps - 1) * whole
    return steps, rest if interval == 0 or steps == 1 else whole, whole, whole if interval == 0 else rest


def _integrate(
    plan: Plan, values: Values, knots: FloatArray, coefficients: FloatArray, substep: float, count: int,
    times: FloatArray, records: IntArray, out: FloatArray, states: FloatArray, work: Work, steps_of: Any,
) -> float:  # fmt: skip
    """Integrates from knots[0] = 0 to knots[-1] in the lanes 0 … count - 1.

    knots: (K + 1,) ascending [s], counted from the origin of each lane, as the output times are; coefficients: (K, 6)
    of the input's polynomial in each interval, lowest order first, or (K, 6 x LANES) of that of each lane; substep:
    longest step [s]; times: (N,) ascending, within the knots;
    records: the signals wanted; out: (lanes, len(records), N) and states: (lanes, N, n), or (lanes, 0, 0), are filled;
    work: begins with the states x.  Returns the largest magnitude of the watched signal of the first lane, which is NaN
    or infinite when its states left the range of numbers.
    """
    m, w, parts, polynomials = terms(plan, values), memory(work), _part_pointers(steps_of), address(coefficients, 0)
    end = lanes_for(count)
    n, x, y, k1, k4 = m.states, w.x, w.y, w.k1, w.k4
    slopes_at(m, w, polynomials, knots[0], x, k1, end)
    peak, o = abs(w.s[m.watch]), 0
    while o < times.size and times[o] <= knots[0]:
        _keep(m, w, x, records, out, states, o, 0, end, count)
        o += 1
    for interval in range(knots.size - 1):
        c, left = offset(polynomials, m.numbers * interval), knots[interval]
        steps, first_step, whole, last_step = _cut(knots, interval, substep)
        for step in range(steps):
            since = step * whole - (whole - first_step) if step else 0.0
            h = first_step if step == 0 else whole if step < steps - 1 else last_step
            begin, finish, passes = left + since, left + since + h, False
            for k in range(count):
                if m.layer[k] > 0.0:
                    at = SPEED * LANES + k
                    passes = passes or _passes(x[at], k1[at], h, m.layer[k])
            if not passes:
                advance(m, w, c, left, x, k1, k4, y, since, h, end)
                if not abs(w.s[m.watch]) <= peak:
                    peak = abs(w.s[m.watch])
                between = False  # from then on s no longer shows the end of the step
                while o < times.size and times[o] <= finish + 1e-6 * h:
                    part = min((times[o] - begin) / h, 1.0)
                    between = between or part < 1 - 1e-6
                    if between:
                        _hermite(n, w, x, k1, y, k4, h, part, 0, end)
                        _evaluate(m, w, c, left, times[o] - left, w.z, 0, end)
                    _keep(m, w, w.z if between else y, records, out, states, o, 0, end, count)
                    o += 1
                x, y = y, x
                k1, k4 = k4, k1
                continue
            _begin(m, w, c, left, x, k1, h, since, parts, o, count)
            while True:
                moves, first, last = _choose(m, w, c, left, x, k1, h, since, parts, count)
                if not moves:
                    break
                if first == last:
                    rk4_of_one(m, w, c, left, x, k1, k4, y, first)
                elif first < last:
                    rk4(m, w, c, left, x, k1, k4, y, end)
                for k in range(count):
                    at = SPEED * LANES + k
                    if parts.done[k] == parts.units[k]:
                        continue
                    if parts.creeps[k]:
                        for i in range(n):
                            y[i * LANES + k], k4[i * LANES + k] = w.z[i * LANES + k], w.k[i * LANES + k]
                    elif parts.size[k] > 1 and (abs(y[at]) < m.layer[k] or x[at] * y[at] < 0.0):
                        parts.size[k], parts.is_new[k] = parts.size[k] >> 1, 0
                        continue
                    if k == 0 and not abs(w.s[m.watch]) <= peak:
                        peak = abs(w.s[m.watch])
                    begin, part_h = left + w.since[k], w.h[k]
                    parts.done[k], parts.is_new[k] = parts.done[k] + parts.size[k], 1
                    ends = parts.done[k] == parts.units[k]
                    finish = left + since + parts.done[k] / parts.units[k] * h
                    while parts.next[k] < times.size and times[parts.next[k]] <= finish + 1e-6 * (
                        h if ends else part_h
                    ):
                        o = parts.next[k]
                        _hermite(n, w, x, k1, y, k4, part_h, min((times[o] - begin) / part_h, 1.0), k, k + 1)
                        _evaluate(m, w, c, left, times[o] - left, w.z, k, k + 1)
                        _keep(m, w, w.z, records, out, states, o, k, k + 1, count)
                        parts.next[k] = o + 1
                    for i in range(n):
                        x[i * LANES + k], k1[i * LANES + k] = y[i * LANES + k], k4[i * LANES + k]
            o = parts.next[0]
    return float(peak)


def _start(plan: Plan, values: Values, coefficients: FloatArray, work: Work) -> None:
    """All signals at one instant in the first lane of work.s."""
    m, w = terms(plan, values), memory(work)
    _evaluate(m, w, address(coefficients, 0), 0.0, 0.0, w.x, 0, 1)
    run(m, w, w.k, m.live, m.count, 0, 1)


_signals = compiled(partial(njit, **OPTIONS), _start)
integrate = compiled(partial(njit, nogil=True, **OPTIONS), _integrate)


def start_signals(plan: Plan, x: FloatArray, time: float, value: float, rate: float) -> FloatArray:
    """All signals at one instant, shape (signals + effects' states,), for states x (n,) and an input with its rate."""
    values = beside([plan], [time])
    work = work_for(plan, values, x[None])
    _signals(plan, values, np.array([[value, rate, 0.0, 0.0, 0.0, 0.0]]), work)
    return work.s[::LANES].copy()


def solve(
    plans: Sequence[Plan], pieces: Sequence[Pieces], substep_s: float, starts: FloatArray, times: FloatArray,
    records: IntArray, origins: Sequence[float], *, keeps_states: bool = False,
) -> tuple[FloatArray, FloatArray, float]:  # fmt: skip
    """Runs from the states starts (K, n), with a plan, an input, and an origin of their times each, or one of all.

    Plans have the same terms, pieces (of the inputs) the same knots; see ``_integrate``.  Returns the signals
    (K, records, N), the states (K, N, n), none unless asked for, and the largest magnitude of the watched signal of the
    first run.
    """
    K, n = starts.shape
    out = np.empty((K, records.size, times.size))
    states = np.empty((K, times.size, n) if keeps_states else (K, 0, 0))
    peak = 0.0
    for lanes in batches(K):
        part, coefficients = starts[lanes], _coefficients(_lanes_of(pieces, lanes))
        values = beside(_lanes_of(plans, lanes), _lanes_of(origins, lanes), coefficients.shape[1])
        found = integrate(
            plans[0], values, pieces[0].knots, coefficients, substep_s, len(part), times, records, out[lanes],
            states[lanes], work_for(plans[0], values, part), Parts.empty(),
        )  # fmt: skip
        peak = peak if lanes.start else found
    return out, states, float(peak)


def _lanes_of(every: Sequence[T], lanes: slice) -> Sequence[T]:
    """Those of these lanes, or the one of all lanes."""
    return every if len(every) == 1 else every[lanes]


def _coefficients(pieces: Sequence[Pieces]) -> FloatArray:
    """The coefficients of one input (K, 6), or of several in lanes (K, 6 x LANES)."""
    if len(pieces) == 1:
        return pieces[0].coefficients
    at = np.minimum(np.arange(LANES), len(pieces) - 1)
    every = np.array([one.coefficients for one in pieces])
    return np.ascontiguousarray(every.transpose(1, 2, 0)[:, :, at]).reshape(len(every[0]), -1)
