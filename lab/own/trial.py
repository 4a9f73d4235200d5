"""A function of the user's is called at many points: does it give numbers, and how steep is it?  No model is run."""

from __future__ import annotations

import numbers
from collections.abc import Callable, Iterator, Mapping
from functools import lru_cache
from typing import Any

import numpy as np

from lostmotion.lab.errors import EffectFileError
from lostmotion.lab.own.arguments import Arguments
from lostmotion.lab.own.readable import READABLE
from lostmotion.model import Parameter
from lostmotion.model.base import Operating
from lostmotion.model.effects import ActsOn
from lostmotion.model.signals import FORCE, INERTIA, OMEGA2, Q_RATE, THETA2, Q

__all__ = ["fastest_rate", "try_out"]

TRIED = 25
PROBED = 300
_CHORD = {THETA2: 1e-3, OMEGA2: 2e-3, Q: 1e-5, Q_RATE: 1e-3}
"""Half the stretch over which a slope is taken [rad, rad/s, m, m/s]: a jump counts as a step of that width, as dry
friction in the catalogue does; a fixed-step solver cannot resolve a sharper one."""
_MOVING = {ActsOn.JOINT: (THETA2, OMEGA2), ActsOn.OSCILLATOR: (Q, Q_RATE)}
_STATE_CHORD = 1e-4


def try_out(name: str, function: Callable[..., Any], arguments: Arguments, parameters: Mapping[str, Parameter]) -> None:
    """Calls the function at rest and in motion.  Raises EffectFileError where it raises or gives no usable number."""
    values = {key: parameter.value for key, parameter in parameters.items()}
    rest, *moving = list(_points(arguments, values, TRIED))
    _tried(name, function, arguments, rest)
    refused = []
    for point in moving:
        try:
            _tried(name, function, arguments, point)
        except EffectFileError as error:
            refused.append(error)
    if len(refused) == len(moving):
        raise refused[0]


def fastest_rate(
    function: Callable[..., Any],
    acts_on: ActsOn,
    arguments: Arguments,
    values: Mapping[str, float],
    operating: Operating,
) -> float:
    """The fastest rate [1/s] that the effect brings into the motion, from its slopes at many points.

    A slope against a speed over the inertia is a rate; one against an angle over it the square of half of one; one of
    a state's derivative against the state is a rate too.  values: of the base and the effect, by short name.
    """
    own = tuple(values[key] for key in arguments.values)
    inertia = operating.inertia if acts_on is ActsOn.JOINT else values.get("m", 1.0)
    load = operating.watched if operating.watched and np.isfinite(operating.watched) else 0.0
    return _fastest(function, acts_on, arguments, own, float(inertia), _rounded(load))


@lru_cache(maxsize=1024)  # a fit comes back to the same values, and every simulation asks twice
def _fastest(
    function: Callable[..., Any],
    acts_on: ActsOn,
    arguments: Arguments,
    own: tuple[float, ...],
    inertia: float,
    load: float,
) -> float:
    values = dict(zip(arguments.values, own, strict=True))
    points = np.array([list(point.values()) for point in _points(arguments, values, PROBED, load)])
    rates = [0.0]
    moving = _MOVING.get(acts_on, ())
    for column, key in enumerate(arguments.names):
        if key in arguments.states:
            which = 1 + arguments.states.index(key)
            rates.append(_steepest(function, points, column, _STATE_CHORD, which))
        elif key in arguments.signals and READABLE[key].number in moving:
            number = READABLE[key].number
            slope = _steepest(function, points, column, _CHORD[number], 0) / inertia
            rates.append(slope if number in (OMEGA2, Q_RATE) else 2 * slope**0.5)
    return max(rates)


def _steepest(
    function: Callable[..., Any], points: np.ndarray[Any, Any], column: int, half: float, which: int
) -> float:
    """The largest slope of the function's result (or of its part ``which``) against one argument."""
    step = np.zeros(points.shape[1])
    step[column] = half
    with np.errstate(all="ignore"):
        rises = [_part(function, point + step, which) - _part(function, point - step, which) for point in points]
    slopes = np.abs(rises) / (2 * half)
    return float(np.max(slopes[np.isfinite(slopes)], initial=0.0))


def _part(function: Callable[..., Any], point: np.ndarray[Any, Any], which: int) -> float:
    try:
        found = function(*point.tolist())
        return float(found[which] if isinstance(found, tuple) else found)
    except Exception:  # noqa: BLE001 - the user's function may raise anything; where it has no value it has no slope
        return float("nan")


def _points(
    arguments: Arguments, values: Mapping[str, float], count: int, load: float = 0.0
) -> Iterator[dict[str, float]]:
    """Arguments by name: at rest first, then of usual magnitudes, always the same; every other one near standstill."""
    rng = np.random.default_rng(0)
    for i in range(count):
        point = {}
        for key in arguments.names:
            if key in arguments.states:
                point[key] = 0.0 if i == 0 else float(rng.uniform(-1, 1))
            elif key in values and key not in arguments.signals:
                point[key] = values[key]
            else:
                signal = READABLE[key]
                usual = max(signal.usual, load) if signal.number == FORCE else signal.usual
                drawn = float(rng.uniform(-usual, usual))
                still = i == 0 or (signal.rate is None and i % 2)
                point[key] = 0.0 if still else drawn
                if signal.number == INERTIA:
                    point[key] = usual
        yield point


def _tried(name: str, function: Callable[..., Any], arguments: Arguments, point: Mapping[str, float]) -> None:
    at = ", ".join(f"{key} = {value:.3g}" for key, value in point.items())
    try:
        with np.errstate(all="ignore"):
            found = function(**point)
    except Exception as error:  # the user's function may raise anything
        raise EffectFileError(f"{name}: raised {type(error).__name__}: {error}, at {at}") from error
    parts = found if arguments.states and isinstance(found, tuple) else (found,)
    expected = "a number"
    if arguments.states:
        expected = f"{1 + len(arguments.states)} numbers: the contribution and each state's derivative"
    if len(parts) != 1 + len(arguments.states) or not all(_is_number(part) for part in parts):
        raise EffectFileError(f"{name}: returned {_shown(found)}, expected {expected}, at {at}")
    if not all(np.isfinite(float(part)) for part in parts):
        raise EffectFileError(f"{name}: returned {_shown(found)}, expected a finite number, at {at}")


def _is_number(found: object) -> bool:
    return isinstance(found, numbers.Real) and not isinstance(found, bool)


def _shown(found: object) -> str:
    if isinstance(found, np.ndarray):
        return f"an array of shape {found.shape}"
    return repr(found) if found is None or isinstance(found, float) else f"{type(found).__name__} {found!r:.60}"


def _rounded(load: float) -> float:
    """Up to a power of two, so that the sub-step does not change with every motion."""
    return 2.0 ** np.ceil(np.log2(load)) if load > 0 else 0.0
