"""Checks a user-defined function by calls at some points.  No model is simulated."""

from __future__ import annotations

import numbers
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from lostmotion.lab.errors import EffectFileError
from lostmotion.lab.models.own.arguments import Arguments
from lostmotion.lab.models.own.points import points
from lostmotion.model import Parameter

__all__ = ["try_out"]

TRIED = 25
"""Number of points at which a function is called."""


def try_out(name: str, function: Callable[..., Any], arguments: Arguments, parameters: Mapping[str, Parameter]) -> str:
    """What the function does at points where it has no finite value, and where these are, in words; "" without any.

    Raises EffectFileError where it raises or returns no finite number at rest, or at every other point.
    """
    values = {key: parameter.value for key, parameter in parameters.items()}
    rest, *moving = (dict(zip(arguments.names, row, strict=True)) for row in points(arguments, values, TRIED).tolist())
    _try(name, function, arguments, rest)
    refused = dict[int, EffectFileError]()
    for at, point in enumerate(moving):
        try:
            _try(name, function, arguments, point)
        except EffectFileError as error:
            refused[at] = error
    if not refused:
        return ""
    first = next(iter(refused.values()))
    if len(refused) == len(moving):
        raise first
    sound = [rest, *(point for at, point in enumerate(moving) if at not in refused)]
    return f"{first}{_where([moving[at] for at in refused], sound, arguments.signals)}"


def _where(refused: Sequence[Mapping[str, float]], sound: Sequence[Mapping[str, float]], signals: Sequence[str]) -> str:
    """The range of the first signal, or of its magnitude, that tells the points that were refused from the others."""
    for written, of in (("{}", float), ("|{}|", abs)):
        for key in signals:
            bad, good = ([of(point[key]) for point in some] for some in (refused, sound))
            if max(bad) < min(good) or min(bad) > max(good):
                return f"; so it is wherever {written.format(key)} was {min(bad):.3g} to {max(bad):.3g}"
    return f"; so it is at {len(refused)} of {len(refused) + len(sound)} points that were tried"


def _try(name: str, function: Callable[..., Any], arguments: Arguments, point: Mapping[str, float]) -> None:
    at = ", ".join(f"{key} = {value:.3g}" for key, value in point.items())
    try:
        with np.errstate(all="ignore"):
            found = function(**point)
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # the user's function may raise any exception
        raise EffectFileError(f"{name}: raised {type(error).__name__}: {error}, at {at}") from error
    count = 1 + len(arguments.states)
    parts = found if arguments.states and isinstance(found, tuple) else (found,)
    if len(parts) != count or not all(map(_is_number, parts)):
        expected = "a number" if count == 1 else f"{count} numbers: the contribution and each state's derivative"
        raise EffectFileError(f"{name}: returned {_shown(found)}, expected {expected}, at {at}")
    if not all(np.isfinite(float(part)) for part in parts):
        raise EffectFileError(f"{name}: returned {_shown(found)}, expected a finite number, at {at}")


def _is_number(found: object) -> bool:
    return isinstance(found, numbers.Real) and not isinstance(found, bool)


def _shown(found: object) -> str:
    if isinstance(found, np.ndarray):
        return f"an array of shape {found.shape}"
    return repr(found) if found is None or isinstance(found, float) else f"{type(found).__name__} {found!r:.60}"
