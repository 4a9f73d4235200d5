"""The compiled integrator: fixed-step RK4 over a list of terms given by address.  It knows no physics.

Time runs over the intervals of the input's polynomial; each is cut into equal steps no longer than asked for, so no
step straddles a knot.  Output times are free: between steps the states follow the cubic Hermite polynomial through both
ends (fourth order, as the steps are), and all signals are evaluated from them.  Only where the speed passes through the
width in which dry friction changes its sign are steps halved, as often as the slope of the acceleration there needs.
Outside of it the motion is smooth and a step is exact to a thousandth of a millionth, whichever is taken: the result is
a smooth function of the parameters, and finite differences of it make sense.

All arrays of a plan are small tables of indices; ``s`` holds the signals, then the effects' own states.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.extending import intrinsic
from numpy.typing import NDArray

from lostmotion.model.kernel import OPTIONS, POINTER, compiled, jitted

__all__ = [
    "SPEED",
    "FloatArray",
    "IntArray",
    "Plan",
    "integrate",
    "integrate_many",
    "load",
    "polynomial",
    "rates",
    "record",
    "rk4",
    "start_signals",
]

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.uint64]
"""Indices; unsigned, because numba checks signed ones for wrapping round, which took 40 % of the time."""


_intrinsic: Callable[[Callable[..., Any]], Callable[..., Any]] = intrinsic

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


class Plan(NamedTuple):
    """A model as tables, T terms, n states of which the first are the base's.

    addresses, targets: (T,) in causal order; fresh: (T,) 1 where the term is the first on its target, which it then
    sets instead of adding to it; p, p_at: parameters of all terms and where each begins; x_at, dx_at: where the term's
    states begin in s and in the states; live: how many terms the derivatives need, the others wait for an output;
    state_at: (n,) where each state stands in s; rate_signals: the signals that are the derivatives of base states;
    input_signals, input_orders: which signals carry the input (order 0) and its derivative (1) before any term;
    presets: signals that terms add to without one that sets them, with their value; start: (S,) signals to begin with;
    time, watch: the signals that hold the time, and whose largest magnitude is reported; layer: the speed up to which
    steps are halved, 0 without dry friction; sharpest: the least width of its change of sign.
    """

    addresses: IntArray
    targets: IntArray
    fresh: IntArray
    p: FloatArray
    p_at: IntArray
    x_at: IntArray
    dx_at: IntArray
    live: int
    state_at: IntArray
    rate_signals: IntArray
    input_signals: IntArray
    input_orders: IntArray
    presets: IntArray
    preset_values: FloatArray
    start: FloatArray
    time: int
    watch: int
    layer: float
    sharpest: float


@_intrinsic
def _call(context: Any, address: Any, s: Any, x: Any, dx: Any, p: Any) -> Any:
    """float64 kernel(s, x, dx, p) at an address."""

    def codegen(_context: Any, builder: Any, _signature: Any, args: Any) -> Any:
        double = ir.DoubleType()
        function = ir.FunctionType(double, [double.as_pointer()] * 4)
        return builder.call(builder.inttoptr(args[0], function.as_pointer()), args[1:])

    return types.float64(types.uint64, POINTER, POINTER, POINTER, POINTER), codegen


@_intrinsic
def _at(context: Any, array: Any, index: Any) -> Any:
    """The address of array[index]."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        data = context.make_array(signature.args[0])(context, builder, args[0]).data
        return builder.gep(data, [args[1]])

    return POINTER(array, index), codegen


@jitted
def polynomial(c: FloatArray, tau: float) -> tuple[float, float]:
    """The polynomial c (6,), lowest order first, and its derivative at tau."""
    value, rate = c[5], 0.0
    for i in range(4, -1, -1):
        rate = rate * tau + value
        value = value * tau + c[i]
    return value, rate


@jitted
def load(
    plan: Plan, s: FloatArray, time: float, value: float, rate: float, x: FloatArray, dx: FloatArray, h: float
) -> None:
    """Sets what the terms start from: time, input, presets, and the states x + h dx."""
    s[plan.time] = time
    for i in range(plan.input_signals.size):
        s[plan.input_signals[i]] = value if plan.input_orders[i] == 0 else rate
    for i in range(plan.presets.size):
        s[plan.presets[i]] = plan.preset_values[i]
    for i in range(x.size):
        s[plan.state_at[i]] = x[i] + h * dx[i]


@jitted
def _run(plan: Plan, s: FloatArray, dx: FloatArray, first: int, last: int) -> None:
    """Evaluates the terms first … last - 1 on the loaded signals."""
    for i in range(first, last):
        value = _call(
            plan.addresses[i], _at(s, 0), _at(s, plan.x_at[i]), _at(dx, plan.dx_at[i]), _at(plan.p, plan.p_at[i])
        )
        target = plan.targets[i]
        s[target] = value if plan.fresh[i] else s[target] + value


@jitted
def rates(plan: Plan, s: FloatArray, dx: FloatArray) -> None:
    """dx = f(loaded s)."""
    _run(plan, s, dx, 0, plan.live)
    for i in range(plan.rate_signals.size):
        dx[i] = s[plan.rate_signals[i]]


@jitted
def record(plan: Plan, s: FloatArray, scratch: FloatArray, records: IntArray, out: FloatArray, o: int) -> None:
    """Evaluates the terms that only outputs need and writes column o."""
    _run(plan, s, scratch, plan.live, plan.targets.size)
    for r in range(records.size):
        out[r, o] = s[records[r]]


@jitted
def _keep(states: FloatArray, o: int, x: FloatArray) -> None:
    """states[o] = x, element by element: numba compiles the words of an error of shapes otherwise, for seconds."""
    for i in range(x.size):
        states[o, i] = x[i]


@jitted
def _hermite(
    x: FloatArray, dx: FloatArray, y: FloatArray, dy: FloatArray, h: float, part: float, z: FloatArray
) -> None:
    """z = the cubic through (x, dx) and (y, dy), h apart, at this part of h."""
    rest = 1.0 - part
    for i in range(x.size):
        ends = rest * x[i] + part * y[i]
        slope = y[i] - x[i]
        z[i] = ends - part * rest * ((rest - part) * slope - h * (rest * dx[i] - part * dy[i]))


@jitted
def rk4(
    plan: Plan,
    s: FloatArray,
    c: FloatArray,
    knot: float,
    since: float,
    h: float,
    x: FloatArray,
    k1: FloatArray,
    k2: FloatArray,
    k3: FloatArray,
    k4: FloatArray,
    y: FloatArray,
) -> None:
    """One classical Runge-Kutta step of h [s] from the states x, with slope k1, to y, whose slope is left in k4.

    It begins ``since`` [s] after the knot at the time ``knot`` [s] from which the input's polynomial c counts.
    """
    value, rate = polynomial(c, since + h / 2)
    load(plan, s, knot + since + h / 2, value, rate, x, k1, h / 2)
    rates(plan, s, k2)
    load(plan, s, knot + since + h / 2, value, rate, x, k2, h / 2)
    rates(plan, s, k3)
    value, rate = polynomial(c, since + h)
    load(plan, s, knot + since + h, value, rate, x, k3, h)
    rates(plan, s, k4)
    for i in range(x.size):
        y[i] = x[i] + h / 6 * (k1[i] + 2 * (k2[i] + k3[i]) + k4[i])
    load(plan, s, knot + since + h, value, rate, y, k4, 0.0)
    rates(plan, s, k4)  # the next step's first slope


@jitted
def _slope(
    plan: Plan, s: FloatArray, c: FloatArray, knot: float, since: float, x: FloatArray, z: FloatArray, dz: FloatArray
) -> float:
    """Fall of the acceleration over the narrowest change of sign of a dry friction [1/s]: its reciprocal is the time in
    which the friction stops the joint there.  z, dz: (n,), (n + 1,) are overwritten."""
    value, rate = polynomial(c, since)
    across = 0.0
    for side in (-0.5, 0.5):
        for i in range(x.size):
            z[i] = x[i]
        z[SPEED] = side * plan.sharpest
        load(plan, s, knot + since, value, rate, z, dz, 0.0)
        rates(plan, s, dz)
        across -= 2 * side * dz[SPEED]
    return across / plan.sharpest


@jitted
def _halvings(stiffness: float) -> int:
    """How often a step of this length, times the slope, is halved until it is ``LAYER_STEP``."""
    halvings = 0
    while stiffness > LAYER_STEP and halvings < MOST_HALVINGS:
        stiffness, halvings = stiffness / 2, halvings + 1
    return halvings


@jitted
def _creep(
    plan: Plan, s: FloatArray, c: FloatArray, knot: float, since: float, h: float, x: FloatArray, k1: FloatArray,
    y: FloatArray, dz: FloatArray, k4: FloatArray,
) -> bool:  # fmt: skip
    """One exponential Rosenbrock-Euler step of h [s] of a joint that friction holds, from x with slope k1 to y with
    slope k4, both useless where it returns False: where the joint does not creep, or is not stiff.  A lag that has a
    state of its own takes a midpoint step.

    omega(t) = omega + a (1 - exp(-lambda t))/lambda, with the acceleration a and its slope lambda in the middle of the
    step (Hochbruck and Ostermann, Exponential integrators, Acta Numerica 2010).
    """
    value, rate = polynomial(c, since + h / 2)
    y[0], y[SPEED] = x[0] + h / 2 * x[SPEED], x[SPEED]
    for j in range(SPEED + 1, x.size):
        y[j] = x[j] + h / 2 * k1[j]
    load(plan, s, knot + since + h / 2, value, rate, y, dz, 0.0)
    rates(plan, s, dz)
    acceleration = dz[SPEED]
    for j in range(SPEED + 1, x.size):
        k4[j] = x[j] + h * dz[j]
    y[SPEED] += CREEP * plan.sharpest
    load(plan, s, knot + since + h / 2, value, rate, y, dz, 0.0)
    rates(plan, s, dz)
    slope = (acceleration - dz[SPEED]) / (CREEP * plan.sharpest)
    if not h * slope > LAYER_STEP:
        return False
    gained = acceleration * (1 - np.exp(-h * slope)) / slope
    if not abs(gained) < CREEP * plan.sharpest:
        return False
    y[0], y[SPEED] = x[0] + h * x[SPEED] + (h * acceleration - gained) / slope, x[SPEED] + gained
    for j in range(SPEED + 1, x.size):
        y[j] = k4[j]
    value, rate = polynomial(c, since + h)
    load(plan, s, knot + since + h, value, rate, y, dz, 0.0)
    rates(plan, s, k4)
    return True


@jitted
def _passes(speed: float, acceleration: float, h: float, layer: float) -> bool:
    """Whether the speed comes within the layer about zero in the next h [s]."""
    end = speed + h * acceleration
    return min(abs(speed), abs(end)) < layer or speed * end < 0.0


def _start_signals(plan: Plan, x: FloatArray, time: float, value: float, rate: float) -> FloatArray:
    """All signals at one instant, shape (signals + effects' states,), for states x (n,) and an input with its rate."""
    s = plan.start.copy()
    dx = np.zeros(x.size + 1)
    load(plan, s, time, value, rate, x, dx, 0.0)
    _run(plan, s, dx, 0, plan.targets.size)
    return s


def _integrate(
    plan: Plan,
    knots: FloatArray,
    coefficients: FloatArray,
    substep: float,
    x0: FloatArray,
    times: FloatArray,
    records: IntArray,
    out: FloatArray,
    states: FloatArray,
    origin: float,
) -> float:
    """Integrates from knots[0] = 0 to knots[-1].  One function: with its inner loop apart, gears take 1.15 to 2.8 times
    as long, as numba then counts references to every array in each step.

    knots: (K + 1,) ascending [s], counted from origin [s] as the output times are; coefficients: (K, 6) of the input's
    polynomial in each interval, lowest order first; substep: longest step [s]; x0: (n,); times: (N,) ascending, within
    the knots; records: the signals wanted; out: (len(records), N) and states: (N, n) are filled.  Returns the largest
    magnitude of the watched signal, which is NaN or infinite when the states left the range of numbers.
    """
    n = x0.size
    s = plan.start.copy()
    x, y, z = x0.copy(), np.empty(n), np.empty(n)
    k1, k2, k3, k4, scratch = np.zeros(n + 1), np.zeros(n + 1), np.zeros(n + 1), np.zeros(n + 1), np.zeros(n + 1)
    value, rate = polynomial(coefficients[0], 0.0)
    load(plan, s, origin + knots[0], value, rate, x, k1, 0.0)
    rates(plan, s, k1)
    peak, o = abs(s[plan.watch]), 0
    while o < times.size and times[o] <= knots[0]:
        record(plan, s, scratch, records, out, o)
        _keep(states, o, x)
        o += 1
    for interval in range(knots.size - 1):
        c, left = coefficients[interval], knots[interval]
        steps = max(1, int(np.ceil((knots[interval + 1] - left) / substep - 1e-9)))
        h = (knots[interval + 1] - left) / steps
        step, units, at, size, slope = 0, 1, 0, 1, 0.0  # at: units of this step that are done; size: of the next part
        while step < steps:
            creeps = False
            if plan.layer > 0.0:
                if at == 0:
                    units = size = 1
                    if _passes(x[SPEED], k1[SPEED], h, plan.layer):
                        slope = _slope(plan, s, c, origin + left, step * h, x, z, k2)
                        units = size = 1 << _halvings(h * slope)
                else:
                    size = at & -at  # so that parts of each size begin at multiples of it
                may_creep = n <= 3 and abs(k1[SPEED]) < CREEP * plan.sharpest * slope
                while size > 1 and _passes(x[SPEED], k1[SPEED], h * size / units, plan.layer):
                    since, part_h = (step + at / units) * h, h * size / units
                    creeps = may_creep and _creep(plan, s, c, origin + left, since, part_h, x, k1, y, k2, k4)
                    if creeps:
                        break
                    size >>= 1
            since, part_h = (step + at / units) * h, h * size / units
            if not creeps:
                rk4(plan, s, c, origin + left, since, part_h, x, k1, k2, k3, k4, y)
                while size > 1 and (abs(y[SPEED]) < plan.layer or x[SPEED] * y[SPEED] < 0.0):
                    size >>= 1
                    part_h = h * size / units
                    rk4(plan, s, c, origin + left, since, part_h, x, k1, k2, k3, k4, y)
            at += size
            if at == units:
                step, at = step + 1, 0
            begin, end = left + since, left + (step + at / units) * h
            if not abs(s[plan.watch]) <= peak:
                peak = abs(s[plan.watch])
            between = False  # from then on s no longer shows the end of the step
            while o < times.size and times[o] <= end + 1e-6 * part_h:
                part = min((times[o] - begin) / part_h, 1.0)
                between = between or part < 1 - 1e-6
                if between:
                    _hermite(x, k1, y, k4, part_h, part, z)
                    value, rate = polynomial(c, times[o] - left)
                    load(plan, s, origin + times[o], value, rate, z, k4, 0.0)
                    _run(plan, s, scratch, 0, plan.live)
                    _keep(states, o, z)
                else:
                    _keep(states, o, y)
                record(plan, s, scratch, records, out, o)
                o += 1
            x, y = y, x
            k1, k4 = k4, k1
    return float(peak)


def _integrate_many(
    plan: Plan,
    knots: FloatArray,
    coefficients: FloatArray,
    substep: float,
    starts: FloatArray,
    times: FloatArray,
    records: IntArray,
    out: FloatArray,
    origin: float,
) -> None:
    """The same from many start states (K, n); out: (K, len(records), N) is filled."""
    states = np.empty((times.size, starts.shape[1]))
    for k in range(starts.shape[0]):
        integrate(plan, knots, coefficients, substep, starts[k], times, records, out[k], states, origin)


start_signals = compiled(lambda **options: njit(**OPTIONS, **options)(_start_signals))
integrate = compiled(lambda **options: njit(nogil=True, **OPTIONS, **options)(_integrate))
integrate_many = compiled(lambda **options: njit(nogil=True, **OPTIONS, **options)(_integrate_many))
