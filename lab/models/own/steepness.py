"""The slopes of a user-defined function, from which the integration step follows.  No model is run."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import lru_cache
from typing import Any

import numpy as np

from lostmotion.lab.models.own.arguments import Arguments
from lostmotion.lab.models.own.points import points
from lostmotion.lab.models.own.readable import READABLE
from lostmotion.model.base import Operating
from lostmotion.model.effects import ActsOn
from lostmotion.model.motion import FloatArray
from lostmotion.model.signals import OMEGA2, Q_RATE, THETA2, Q

__all__ = ["fastest_rate"]

PROBED = 300
CHORD = {THETA2: 1e-3, OMEGA2: 2e-3, Q: 1e-5, Q_RATE: 1e-3}
"""Half the segment over which a slope is taken [rad, rad/s, m, m/s]: a jump counts as a step of that width, as dry
friction in the catalogue does; a fixed-step solver cannot resolve a sharper one."""
STATE_CHORD = 1e-4
MOVING = {ActsOn.JOINT: (THETA2, OMEGA2), ActsOn.OSCILLATOR: (Q, Q_RATE)}


def fastest_rate(
    function: Callable[..., Any],
    acts_on: ActsOn,
    arguments: Arguments,
    values: Mapping[str, float],
    operating: Operating,
) -> float:
    """The fastest rate [1/s] that the effect brings into the motion, from its slopes at many points.

    The slope against a speed over the inertia is a rate; that against an angle over the inertia is the square of half a
    rate; that of a state's derivative against the state is a rate too.  values: of base and effect, by short name.
    """
    own = tuple(values[key] for key in arguments.values)
    inertia = operating.inertia if acts_on is ActsOn.JOINT else values.get("m", 1.0)
    return _fastest(function, acts_on, arguments, own, float(inertia), _rounded(operating.watched or 0.0))


@lru_cache(maxsize=1024)  # a fit repeats the same values, and every simulation calls twice
def _fastest(
    function: Callable[..., Any],
    acts_on: ActsOn,
    arguments: Arguments,
    own: tuple[float, ...],
    inertia: float,
    load: float,
) -> float:
    values = dict(zip(arguments.values, own, strict=True))
    table = np.array([list(point.values()) for point in points(arguments, values, PROBED, load)])
    rates = [0.0]
    for column, key in enumerate(arguments.names):
        if key in arguments.states:
            rates.append(_steepest(function, table, column, STATE_CHORD, 1 + arguments.states.index(key)))
        elif key in arguments.signals and (number := READABLE[key].number) in MOVING.get(acts_on, ()):
            slope = _steepest(function, table, column, CHORD[number], 0) / inertia
            rates.append(slope if number in (OMEGA2, Q_RATE) else 2 * math.sqrt(slope))
    return max(rates)


def _steepest(function: Callable[..., Any], table: FloatArray, column: int, half: float, which: int) -> float:
    """The largest slope of the function's result (or of its part ``which``) against one argument."""
    step = np.zeros(table.shape[1])
    step[column] = half
    with np.errstate(all="ignore"):
        rises = [_part(function, point + step, which) - _part(function, point - step, which) for point in table]
    slopes = np.abs(rises) / (2 * half)
    return float(np.max(slopes[np.isfinite(slopes)], initial=0.0))


def _part(function: Callable[..., Any], point: FloatArray, which: int) -> float:
    try:
        found = function(*point.tolist())
        return float(found[which] if isinstance(found, tuple) else found)
    except KeyboardInterrupt:
        raise
    except BaseException:  # noqa: BLE001 - the user's function may raise anything; where it has no value it has no slope
        return math.nan


def _rounded(load: float) -> float:
    """Up to a power of two, so that the sub-step does not change with every motion."""
    return 2.0 ** math.ceil(math.log2(load)) if 0 < load < math.inf else 0.0
