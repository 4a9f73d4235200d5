"""Which series is how fast another one changes: what numbers say of positions and speeds that no name tells."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lostmotion.drivers.base import FloatArray
from lostmotion.drivers.formats.table import LEAST_ROWS
from lostmotion.drivers.formats.words import SPEED_LETTER, UNNAMED, column_of, is_input, speed_of

__all__ = ["Factor", "Rate", "are_of_one_array", "factor_of", "rates"]

BLOCKS = 200
"""pieces of a recording, in each of which the way is compared with the sum of the speed: noise averages out"""
ROUNDED = 0.001
"""Share of the variance of the ways that their rounding may have; pieces are longer where it has more.  A motor's angle
in whole degrees at 160 samples a second, beside its speed: factors of 1.010, 1.005, 1.008 and 1.018, with 0.01 up to
1.023, and with one row a piece 1.012 to 1.024."""
ALIKE = 0.9
"""Correlation of way and speed: a joint's speed by a filter of its own has 0.92, encoders 0.98 to 0.9999."""
EVEN = 0.05
"""share of its size by which a speed must change: a counter ascends evenly, and every constant is its speed"""
ROWS = (5.0, 1e5)
"""rows a second of a log"""
EXACT = 0.02
"""how far the factor between columns without names may be from one: a torque is how fast a speed changes, too, but not
in the same unit"""
INDEX = re.compile(r"\[\d+\]$")
"""of the column of an array"""

IN_DEGREES = (180 / np.pi, 6.0)
"""the factor between an angle in degrees and a speed in rad/s, and one in rpm"""
OFF = 0.04
"""How far a factor may be off beside noise: speeds that drives filter are 0.03 off, and that of a gear of 60:1, where
the angle is that of the motor, is 0.047 from that of degrees."""


@dataclass(frozen=True, slots=True)
class Factor:
    """The factor of a speed that makes it how fast a position changes: by the regression of the position's changes on
    the speed's sums, which noise of the speed makes too small, and by the inverse regression, which noise of the
    position makes too large (errors in variables).  In 60 simulated motions whose speed has as much noise as motion the
    first is 4 to 15 % too small."""

    least: float
    most: float

    def may_be(self, wanted: float) -> bool:
        """Whether it may be this one: whether that is between both, but for a filter of the speed."""
        return self.least * (1 - OFF) < wanted < self.most * (1 + OFF)


@dataclass(frozen=True, slots=True)
class Rate:
    """speed: the series that is how fast ``of`` changes; factor: [of/s]/[speed], or the length of a row [s] where the
    times are unknown."""

    of: str
    speed: str
    factor: Factor

    @property
    def unit(self) -> str:
        """The unit of an angle, as the factor says it; "" where it does not."""
        return "deg" if any(self.factor.may_be(one) for one in IN_DEGREES) else ""


def rates(columns: Mapping[str, NDArray[Any]], times: FloatArray | None) -> list[Rate]:
    """By the first of each chain, as of angle, speed and acceleration, the series that is how fast it changes: a speed
    by its name, or one without a name, of the same array, or called ``v`` where both have the same unit.  times: (N,)
    [s], None where they are unknown, for which ``factor`` is the length of a row [s]."""
    known = {name: np.asarray(values, dtype=float) for name, values in columns.items()}
    rows = next(iter(known.values())).size
    if rows < LEAST_ROWS:
        return []
    steps = np.ones(rows) if times is None else np.gradient(times)
    found = [rate for of in known for speed in known if of != speed and (rate := _rate(known, of, speed, steps))]
    speeds = {rate.speed for rate in found}
    best: dict[str, Rate] = {}
    for rate in found:
        if times is None:
            fits = ROWS[0] <= 1 / rate.factor.least <= ROWS[1]
        else:
            fits = speed_of(rate.speed) is not None or abs(rate.factor.least - 1) <= EXACT
        if rate.of not in speeds and fits:
            best.setdefault(rate.of, rate)
    return list(best.values())


def are_of_one_array(*names: str) -> bool:
    """Whether these are columns of one array, as ``data[2]`` and ``data[3]``."""
    return len({INDEX.sub("[]", name) for name in names}) == 1


def _rate(columns: Mapping[str, FloatArray], of: str, speed: str, steps: FloatArray) -> Rate | None:
    may_be = UNNAMED.fullmatch(speed) or SPEED_LETTER.fullmatch(speed) or are_of_one_array(of, speed)
    is_speed = may_be or speed_of(speed) is not None
    if not is_speed or speed_of(of) is not None or column_of(of) or is_input(of):
        return None
    factor = factor_of(columns[of], columns[speed] * steps)
    return Rate(of, speed, factor) if factor else None


def factor_of(position: FloatArray, velocity: FloatArray) -> Factor | None:
    """The factor of a speed (N,), times the length of each row, that makes it how fast a position (N,) changes; None
    where it is not."""
    fine = np.isfinite(position) & np.isfinite(velocity)
    if np.count_nonzero(fine) < LEAST_ROWS:
        return None
    position, velocity = position[fine], velocity[fine]
    ends = _pieces(position)
    way = np.diff(position[ends])
    total = np.concatenate([[0.0], np.cumsum((velocity[1:] + velocity[:-1]) / 2)])
    sums = np.diff(total[ends])
    if any(np.std(one) <= EVEN * np.sqrt(np.mean(one**2)) for one in (way, sums)):
        return None
    both = float(way @ sums)
    is_alike = both > 0 and float(np.corrcoef(way, sums)[0, 1]) > ALIKE
    return Factor(both / float(sums @ sums), float(way @ way) / both) if is_alike else None


def _pieces(position: FloatArray) -> NDArray[np.intp]:
    """The first samples of the pieces: as short ones as the rounding of the position (N,) allows, two of which make an
    error of tick²/6 in each way."""
    distinct = np.diff(np.unique(position))
    tick = float(distinct.min()) if distinct.size else 0.0
    length = max(position.size // BLOCKS, 1)
    while position.size >= 2 * LEAST_ROWS * length and tick**2 / 6 > ROUNDED * np.var(np.diff(position[::length])):
        length *= 2
    return np.arange(0, position.size, length)
