"""Sample points at which a user-defined function is evaluated: at rest and at usual magnitudes of the signals.

They are the same at each call, so that integration steps are reproducible.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from lostmotion.lab.models.own.arguments import Arguments
from lostmotion.lab.models.own.readable import READABLE
from lostmotion.model.motion import FloatArray
from lostmotion.model.signals import FORCE, INERTIA, OMEGA2, Q_RATE

__all__ = ["points"]


def points(arguments: Arguments, values: Mapping[str, float], count: int, load: float | None = None) -> FloatArray:
    """The values of the K arguments at some points (count, K), the first at rest.

    Every other point has zero speed, where friction is steepest.  At every third a signal has the value of a parameter
    of the same unit, such as the middle of a tight spot.  values: of the parameters; load: largest magnitude of the
    load, where it is known.
    """
    drawn, chosen = _drawn(count, len(arguments.names))
    known = {key: values[key] for key in arguments.values}
    found = np.empty_like(drawn)
    for at, key in enumerate(arguments.names):
        found[:, at] = _column(key, arguments, known, drawn[:, at], chosen[:, at], load)
    return found


@lru_cache(maxsize=64)
def _drawn(count: int, many: int) -> tuple[FloatArray, NDArray[np.intp]]:
    """Random numbers from -1 to 1, and random integers, (count, many) each."""
    rng = np.random.default_rng(0)
    return rng.uniform(-1, 1, (count, many)), rng.integers(0, 1 << 30, (count, many))


def _column(
    key: str, arguments: Arguments, known: Mapping[str, float], drawn: FloatArray, chosen: NDArray[np.intp],
    load: float | None,
) -> FloatArray | float:  # fmt: skip
    """The values of one argument at the points (count,); known: those of the parameters; drawn, chosen: random
    numbers."""
    if key in known:
        return known[key]
    row = np.arange(drawn.size)
    if key in arguments.states:
        return np.where(row > 0, drawn, 0.0)
    signal = READABLE[key]
    usual = load if load is not None and signal.number == FORCE else signal.usual
    if signal.number == INERTIA:
        return usual
    marks = [known[own] for own, unit in zip(arguments.own, arguments.units, strict=True) if unit == signal.unit]
    at_mark = np.array(marks)[chosen % len(marks)] if marks else usual * drawn
    found = np.where(row % 3 == 0, at_mark, usual * drawn)
    is_at_rest = (row == 0) | ((row % 2 == 1) & (signal.number in (OMEGA2, Q_RATE)))
    return np.where(is_at_rest, 0.0, found)
