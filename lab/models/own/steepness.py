"""The slopes of a user-defined function, from which the solver chooses its integration step.

``sign_width`` is the speed within which dry friction changes its sign, and ``fastest_rate`` follows from the slopes at
other speeds.  No model is simulated here.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import lru_cache
from typing import Any

import numpy as np

from lostmotion.lab.models.own.arguments import Arguments
from lostmotion.lab.models.own.points import points
from lostmotion.lab.models.own.readable import READABLE
from lostmotion.model.assemble import LAYER
from lostmotion.model.base import Operating
from lostmotion.model.effects import ActsOn
from lostmotion.model.motion import FloatArray
from lostmotion.model.signals import OMEGA2, Q_RATE, THETA2, Q

__all__ = ["fastest_rate", "sign_width"]

PROBED, PROBED_AT_REST = 300, 40
"""Number of points at which slopes are taken, at all speeds and at rest."""
CHORD = {THETA2: 1e-3, OMEGA2: 2e-3, Q: 1e-5, Q_RATE: 1e-3}
"""Half the segment over which a slope is taken [rad, rad/s, m, m/s]: a jump counts as a step of that width, as dry
friction in the catalogue does; a fixed-step solver cannot resolve a sharper one."""
STATE_CHORD = 1e-4
"""Half the segment over which a slope by a state of the effect is taken."""
MOVING = {ActsOn.JOINT: (THETA2, OMEGA2), ActsOn.OSCILLATOR: (Q, Q_RATE)}
"""By part that an effect acts on, the signals of its place and its speed."""
SEEN = 0.8
"""Least share of the slope at rest that the solver measures across the width, so that its steps are short enough; of
tanh(omega/omega_0) it is 0.8 with a width of 1.7 omega_0."""


def fastest_rate(
    function: Callable[..., Any],
    acts_on: ActsOn,
    arguments: Arguments,
    values: Mapping[str, float],
    operating: Operating,
) -> float:
    """The fastest rate [1/s] that the effect brings into the motion, from its slopes at many points.

    The slope against a speed over the inertia is a rate; that against an angle over the inertia is the square of half a
    rate; that of a state's derivative against the state is a rate too.  Slopes where dry friction changes its sign do
    not count: the solver's steps are short there (``sign_width``).  values: of base and effect, by short name.
    """
    inertia = operating.inertia if acts_on is ActsOn.JOINT else values.get("m", 1.0)
    own, speed = _rounded(arguments, values), Q_RATE if math.isnan(operating.inertia) else OMEGA2
    width = sign_width(function, acts_on, arguments, values, speed)
    return _fastest(
        function, acts_on, arguments, own, float(inertia), _power_of_two(operating.watched or 0.0), LAYER * width
    )


def sign_width(
    function: Callable[..., Any], acts_on: ActsOn, arguments: Arguments, values: Mapping[str, float], speed: int
) -> float:
    """The speed [rad/s or m/s] within which the function changes its sign with the speed, as dry friction does; 0 where
    it does not.  speed: the signal of the base's speed."""
    key = next((key for key in arguments.signals if READABLE[key].number == speed), "")
    if not key or speed not in MOVING.get(acts_on, ()):
        return 0.0
    return _sign_width(function, arguments, _rounded(arguments, values), key)


def _rounded(arguments: Arguments, values: Mapping[str, float]) -> tuple[float, ...]:
    """The values that the function gets, to a sixteenth of a power of two: a fit asks for many that are nearly equal,
    and the step must not change with each of them."""
    parts = (math.frexp(values[key]) for key in arguments.values)
    return tuple(math.ldexp(round(16 * part) / 16, exponent) for part, exponent in parts)


@lru_cache(maxsize=1024)
def _sign_width(function: Callable[..., Any], arguments: Arguments, own: tuple[float, ...], key: str) -> float:
    """The width for which a motion costs least: within ``LAYER`` widths of rest its steps follow from the slope at
    rest, outside from the largest slope there, and the speed is within so many widths for this share of the time.

    A slope that does not fall, as that of viscous friction, has no such width, nor has a function that is steeper
    elsewhere than at rest: the solver measures the slope there.
    """
    signal, column = READABLE[key], arguments.names.index(key)
    half = CHORD[signal.number]
    table = points(arguments, dict(zip(arguments.values, own, strict=True)), PROBED_AT_REST)

    def steepest(speed: float, chord: float = half) -> float:
        sides = (np.where(np.arange(table.shape[1]) == column, side * speed, table) for side in (1.0, -1.0))
        return max(_steepest(function, side, column, chord, 0) for side in sides)

    at_rest = steepest(0.0)
    speeds = half * 2.0 ** np.arange(1, math.ceil(math.log2(signal.usual / half)) + 1)
    slopes = np.array([steepest(speed) for speed in speeds])
    found, least = 0.0, at_rest
    for at, layer in enumerate(speeds.tolist()):
        outside = float(slopes[at:].max())
        cost = outside + at_rest * layer / signal.usual
        is_seen = steepest(0.0, layer / LAYER / 2) >= SEEN * at_rest >= SEEN * float(slopes[: at + 1].max())
        if cost < least and is_seen and layer >= LAYER * half:
            found, least = layer / LAYER, cost
    return found


@lru_cache(maxsize=1024)  # every simulation calls twice
def _fastest(
    function: Callable[..., Any],
    acts_on: ActsOn,
    arguments: Arguments,
    own: tuple[float, ...],
    inertia: float,
    load: float,
    layer: float,
) -> float:
    """See ``fastest_rate``; layer: the speed up to which the solver's steps are short [rad/s or m/s]."""
    table, rates = points(arguments, dict(zip(arguments.values, own, strict=True)), PROBED, load), [0.0]
    for column, key in enumerate(arguments.names):
        if key in arguments.states:
            rates.append(_steepest(function, table, column, STATE_CHORD, 1 + arguments.states.index(key)))
        elif key in arguments.signals and (number := READABLE[key].number) in MOVING.get(acts_on, ()):
            is_speed, beside = number in (OMEGA2, Q_RATE), table
            if is_speed and layer:
                speed = table[:, column]
                outside = np.copysign(np.maximum(np.abs(speed), layer), speed)
                beside = np.where(np.arange(table.shape[1]) == column, outside[:, None], table)
            slope = _steepest(function, beside, column, CHORD[number], 0) / inertia
            rates.append(slope if is_speed else 2 * math.sqrt(slope))
    return max(rates)


def _steepest(function: Callable[..., Any], table: FloatArray, column: int, half: float, which: int) -> float:
    """The largest slope of the result of a function, of which it is the element ``which``, by one argument (column)
    over these points (count, K); half: half the chord."""
    step = np.zeros(table.shape[1])
    step[column] = half
    with np.errstate(all="ignore"):
        rises = [_part(function, point + step, which) - _part(function, point - step, which) for point in table]
    slopes = np.abs(rises) / (2 * half)
    return float(np.max(slopes[np.isfinite(slopes)], initial=0.0))


def _part(function: Callable[..., Any], point: FloatArray, which: int) -> float:
    """One element of the result of a function at a point (K,); NaN where it raises."""
    try:
        found = function(*point.tolist())
        return float(found[which] if isinstance(found, tuple) else found)
    except KeyboardInterrupt:
        raise
    except BaseException:  # noqa: BLE001 - the user's function may raise anything; where it has no value it has no slope
        return math.nan


def _power_of_two(load: float) -> float:
    """The next power of two, so that the integration step does not change with every motion; 0 where it is not
    known."""
    return 2.0 ** math.ceil(math.log2(load)) if 0 < load < math.inf else 0.0
