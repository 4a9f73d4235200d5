"""The tables of a model, their evaluation, and one Runge-Kutta step, for several simulations side by side.

A simulation is a lane (lanes.py): all arrays that change have one row for each signal or state, and one column for each
lane.  The lanes of a run share the input, the output times and the terms of the model, and differ in states and values.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lostmotion.model.kernel import jitted, subroutine
from lostmotion.model.lanes import LANES, VECTOR, address, call, lane, offset

__all__ = [
    "ORDERS", "FloatArray", "IntArray", "Plan", "Pointer", "Terms", "Values", "Work", "advance", "beside",
    "in_lanes", "inputs", "lanes_for", "load", "memory", "rates", "rk4", "rk4_of_one", "run", "slopes_at", "terms",
    "work_for",
]  # fmt: skip

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
Pointer = Any
"""To the first number of an array of lanes, within compiled code."""


ORDERS = 6
"""Numbers of the polynomial of an input in an interval, lowest order first."""


class Plan(NamedTuple):
    """A model as tables, T terms, n states of which the first are the base's, S signals.

    addresses, targets: (T,) in causal order; fresh: (T,) 1 where the term is the first on its target, which it then
    sets instead of adding to it; p_at: where the parameters of each term begin; x_at, dx_at: where the term's states
    begin in the signals and in the states; live: how many terms the derivatives need, the others wait for an output;
    state_at: (n,) where each state stands among the signals; rate_signals: the signals that are the derivatives of base
    states; input_signals, input_orders: which signals carry the input (order 0) and its derivative (1) before any term;
    presets: signals that terms add to without one that sets them; time, watch: the signals that hold the time, and
    whose largest magnitude is reported.

    constants: what models with the same terms differ in, one after the other: the parameters of all terms; the values
    of presets; (S,) signals to begin with, those of the model, then the effects' own states, from ``start_at`` on; the
    speed up to which steps are halved, 0 without dry friction (layer); the least width of its change of sign
    (sharpest).
    """

    addresses: NDArray[np.uint64]
    targets: IntArray
    fresh: IntArray
    p_at: IntArray
    x_at: IntArray
    dx_at: IntArray
    live: int
    state_at: IntArray
    rate_signals: IntArray
    input_signals: IntArray
    input_orders: IntArray
    presets: IntArray
    time: int
    watch: int
    constants: FloatArray
    start_at: int


class Values(NamedTuple):
    """What differs between lanes beside their states: constants of ``Plan``, (rows x LANES,), and the origin of their
    times [s]; numbers: of the input's polynomial in an interval, 6 for one that all lanes share, else 6 x LANES."""

    constants: FloatArray
    origin: FloatArray
    numbers: int


class Terms(NamedTuple):
    """The tables of a plan and the values of the lanes as pointers, with their lengths, within compiled code: arrays
    have seven fields each, which every call would copy."""

    addresses: Any
    targets: Any
    fresh: Any
    p: Any
    p_at: Any
    x_at: Any
    dx_at: Any
    live: Any
    count: Any
    state_at: Any
    states: Any
    rate_signals: Any
    rates: Any
    input_signals: Any
    input_orders: Any
    inputs: Any
    presets: Any
    preset_values: Any
    preset_count: Any
    time: Any
    watch: Any
    layer: Any
    sharpest: Any
    origin: Any
    numbers: Any


class Work(NamedTuple):
    """Memory of a run, an array of lanes each: signals s; states x, y, z; derivatives k1 to k4, k; time, value and
    rate of the input; since, h: begin and length of a step; slope: of a friction; out: of a kernel; none: zeros."""

    s: FloatArray
    x: FloatArray
    y: FloatArray
    z: FloatArray
    k1: FloatArray
    k2: FloatArray
    k3: FloatArray
    k4: FloatArray
    k: FloatArray
    time: FloatArray
    value: FloatArray
    rate: FloatArray
    since: FloatArray
    h: FloatArray
    slope: FloatArray
    out: FloatArray
    none: FloatArray


def beside(plans: Sequence[Plan], origins: Sequence[float], numbers: int = ORDERS) -> Values:
    """The values of up to ``LANES`` plans with the same terms, and the origins of their times [s]; one alone is that of
    all lanes, and the last one also that of the lanes that are left."""
    return Values(in_lanes([plan.constants for plan in plans]), in_lanes(origins), numbers)


def in_lanes(every: Sequence[FloatArray | float]) -> FloatArray:
    """Numbers, or arrays (rows,), one for each lane, as an array of lanes (rows x LANES,)."""
    if len(every) == 1:
        return np.repeat(every[0], LANES)
    at = np.minimum(np.arange(LANES), len(every) - 1)
    return np.array(every).reshape(len(every), -1).T[:, at].ravel()


def work_for(plan: Plan, values: Values, starts: FloatArray) -> Work:
    """The memory for runs from the states starts (K, n), K at most ``LANES``."""
    n = plan.state_at.size
    at = np.minimum(np.arange(LANES), len(starts) - 1)
    x = starts[at].T.ravel()
    states, slopes, rows = (np.zeros((count, rows * LANES)) for count, rows in ((2, n), (5, n + 1), (8, 1)))
    signals = values.constants[plan.start_at * LANES : -2 * LANES].copy()
    return Work(signals, x, *states, *slopes, *rows)


@jitted
def terms(plan: Plan, values: Values) -> Any:
    """The ``Terms`` of a plan with these values."""
    constants, last = address(values.constants, 0), values.constants.size - LANES
    preset_values = offset(constants, (plan.start_at - plan.presets.size) * LANES)
    return Terms(
        address(plan.addresses, 0), address(plan.targets, 0), address(plan.fresh, 0), constants,
        address(plan.p_at, 0), address(plan.x_at, 0), address(plan.dx_at, 0), plan.live, plan.targets.size,
        address(plan.state_at, 0), plan.state_at.size, address(plan.rate_signals, 0), plan.rate_signals.size,
        address(plan.input_signals, 0), address(plan.input_orders, 0), plan.input_signals.size,
        address(plan.presets, 0), preset_values, plan.presets.size, plan.time * LANES,
        plan.watch * LANES, offset(constants, last - LANES), offset(constants, last),
        address(values.origin, 0), values.numbers,
    )  # fmt: skip


@jitted
def memory(w: Work) -> Any:
    """The same as pointers to the first number of each array."""
    return Work(
        address(w.s, 0), address(w.x, 0), address(w.y, 0), address(w.z, 0), address(w.k1, 0), address(w.k2, 0),
        address(w.k3, 0), address(w.k4, 0), address(w.k, 0), address(w.time, 0), address(w.value, 0),
        address(w.rate, 0), address(w.since, 0), address(w.h, 0), address(w.slope, 0), address(w.out, 0),
        address(w.none, 0),
    )  # fmt: skip


@jitted
def polynomial(c0: float, c1: float, c2: float, c3: float, c4: float, c5: float, tau: float) -> tuple[float, float]:
    """The polynomial with these coefficients, lowest order first, and its derivative at tau."""
    value = c0 + tau * (c1 + tau * (c2 + tau * (c3 + tau * (c4 + tau * c5))))
    return value, c1 + tau * (2 * c2 + tau * (3 * c3 + tau * (4 * c4 + tau * (5 * c5))))


@jitted
def inputs(
    m: Any, w: Any, c: Pointer, left: float, since: Pointer, part: float, h: Pointer, first: int, end: int
) -> None:
    """Sets the time, and the input with its derivative, at a part of the steps h [s] of the lanes first … end - 1.

    They begin ``since`` [s] after a knot, ``left`` [s] from the origins of their times, from which the polynomial c
    counts: of all lanes, or one for each.
    """
    for k in range(first, end):
        w.time[k] = m.origin[k] + left + (since[k] + part * h[k])
    if m.numbers == ORDERS:
        c0, c1, c2, c3, c4, c5 = c[0], c[1], c[2], c[3], c[4], c[5]
        for k in range(first, end):
            tau = since[k] + part * h[k]
            w.value[k], w.rate[k] = polynomial(c0, c1, c2, c3, c4, c5, tau)
    else:
        for k in range(first, end):
            tau, one = since[k] + part * h[k], lane(c, k)
            w.value[k], w.rate[k] = polynomial(one[0], one[1], one[2], one[3], one[4], one[5], tau)


@jitted
def load(m: Any, w: Any, x: Pointer, dx: Pointer, part: float, h: Pointer, first: int, end: int) -> None:
    """Sets what the terms start from in the lanes first … end - 1: time, input, presets, and the states x + part h dx;
    m, w: ``Terms`` and ``Work`` of the run."""
    s = w.s
    for k in range(first, end):
        s[m.time + k] = w.time[k]
    for i in range(m.inputs):
        row, source = m.input_signals[i] * LANES, w.value if m.input_orders[i] == 0 else w.rate
        for k in range(first, end):
            s[row + k] = source[k]
    for i in range(m.preset_count):
        row, at = m.presets[i] * LANES, i * LANES
        for k in range(first, end):
            s[row + k] = m.preset_values[at + k]
    for i in range(m.states):
        row, at = m.state_at[i] * LANES, i * LANES
        for k in range(first, end):
            s[row + k] = x[at + k] + part * h[k] * dx[at + k]


@jitted
def run(m: Any, w: Any, dx: Pointer, begin: int, last: int, first: int, end: int) -> None:
    """Evaluates the terms begin … last - 1 on the loaded signals of the lanes first … end - 1."""
    s, out = w.s, w.out
    for i in range(begin, last):
        x, its = offset(s, m.x_at[i] * LANES + first), offset(dx, m.dx_at[i] * LANES + first)
        p = offset(m.p, m.p_at[i] * LANES + first)
        row, is_fresh = m.targets[i] * LANES, m.fresh[i] != 0
        to = offset(s, row + first) if is_fresh else offset(out, first)
        call(m.addresses[i], offset(s, first), x, its, p, to, end - first)
        if not is_fresh:
            for k in range(first, end):
                s[row + k] += out[k]


@jitted
def rates(m: Any, w: Any, dx: Pointer, first: int, end: int) -> None:
    """dx = f(loaded signals) in the lanes first … end - 1."""
    run(m, w, dx, 0, m.live, first, end)
    for i in range(m.rates):
        row, at = m.rate_signals[i] * LANES, i * LANES
        for k in range(first, end):
            dx[at + k] = w.s[row + k]


@jitted
def _step(
    m: Any, w: Any, c: Pointer, left: float, x: Pointer, k1: Pointer, k4: Pointer, y: Pointer, first: int, end: int
) -> None:
    """One classical Runge-Kutta step of the lanes first … end - 1, with their ``since`` and ``h``, from the states x,
    with slopes k1, to y, whose slopes are left in k4; c, left: see ``inputs``."""
    inputs(m, w, c, left, w.since, 0.5, w.h, first, end)
    load(m, w, x, k1, 0.5, w.h, first, end)
    rates(m, w, w.k2, first, end)
    load(m, w, x, w.k2, 0.5, w.h, first, end)
    rates(m, w, w.k3, first, end)
    inputs(m, w, c, left, w.since, 1.0, w.h, first, end)
    load(m, w, x, w.k3, 1.0, w.h, first, end)
    rates(m, w, k4, first, end)
    for i in range(m.states):
        at = i * LANES
        for k in range(first, end):
            middle = w.k2[at + k] + w.k3[at + k]
            y[at + k] = x[at + k] + w.h[k] / 6 * (k1[at + k] + 2 * middle + k4[at + k])
    load(m, w, y, k4, 0.0, w.h, first, end)
    rates(m, w, k4, first, end)  # the next step's first slope


@subroutine
def rk4(m: Any, w: Any, c: Pointer, left: float, x: Pointer, k1: Pointer, k4: Pointer, y: Pointer, end: int) -> None:
    """``_step`` of the lanes 0 … end - 1."""
    _step(m, w, c, left, x, k1, k4, y, 0, end)


@subroutine
def rk4_of_one(
    m: Any, w: Any, c: Pointer, left: float, x: Pointer, k1: Pointer, k4: Pointer, y: Pointer, one: int
) -> None:
    """``_step`` of one lane, without loops."""
    _step(m, w, c, left, x, k1, k4, y, one, one + 1)


@jitted
def lanes_for(count: int) -> int:
    """How many lanes are computed for so many runs: one, or a multiple of ``VECTOR``."""
    return 1 if count == 1 else (count + VECTOR - 1) // VECTOR * VECTOR


@subroutine
def slopes_at(m: Any, w: Any, c: Pointer, left: float, x: Pointer, k1: Pointer, end: int) -> None:
    """The signals and the slopes k1 = f(x) at a knot, in the lanes 0 … end - 1."""
    inputs(m, w, c, left, w.none, 0.0, w.none, 0, end)
    load(m, w, x, k1, 0.0, w.none, 0, end)
    rates(m, w, k1, 0, end)


@jitted
def equal_steps(length: float, substep: float) -> int:
    """The number of equal steps no longer than ``substep`` in an interval."""
    return max(1, int(np.ceil(length / substep - 1e-9)))


@jitted
def advance(
    m: Any, w: Any, c: Pointer, left: float, x: Pointer, k1: Pointer, k4: Pointer, y: Pointer, since: float, h: float,
    end: int,
) -> None:  # fmt: skip
    """The step that begins so long after a knot, of the same length h [s] in the lanes 0 … end - 1; see ``_step``."""
    for k in range(end):
        w.since[k], w.h[k] = since, h
    if end == 1:
        rk4_of_one(m, w, c, left, x, k1, k4, y, 0)
    else:
        rk4(m, w, c, left, x, k1, k4, y, end)
