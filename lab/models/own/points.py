"""Sample points at which a user-defined function is evaluated: at rest and at usual magnitudes, always the same."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from lostmotion.lab.models.own.arguments import Arguments
from lostmotion.lab.models.own.readable import READABLE
from lostmotion.model.signals import FORCE, INERTIA, OMEGA2, Q_RATE

__all__ = ["points"]


def points(
    arguments: Arguments, values: Mapping[str, float], count: int, load: float | None = None
) -> Iterator[dict[str, float]]:
    """Arguments by name, at rest first.

    Every other point has zero speed, where friction is steepest; every third is at the value of a parameter of the same
    unit (the middle of a tight spot).  values: of the parameters; load: its largest magnitude, where it is known.
    """
    rng = np.random.default_rng(0)
    for i in range(count):
        yield {key: _value(key, arguments, values, rng, i, load) for key in arguments.names}


def _value(
    key: str, arguments: Arguments, values: Mapping[str, float], rng: np.random.Generator, i: int, load: float | None
) -> float:
    if key in arguments.values:
        return values[key]
    if key in arguments.states:
        return float(rng.uniform(-1, 1)) if i else 0.0
    signal = READABLE[key]
    usual = load if load is not None and signal.number == FORCE else signal.usual
    if signal.number == INERTIA:
        return usual
    drawn = float(rng.uniform(-usual, usual))
    if i == 0 or (i % 2 and signal.number in (OMEGA2, Q_RATE)):
        return 0.0
    marks = [values[own] for own, unit in zip(arguments.own, arguments.units, strict=True) if unit == signal.unit]
    return float(rng.choice(marks)) if marks and i % 3 == 0 else drawn
