"""The commands around a stretch of acceleration as one smooth motion that can be differentiated.  Knows no sensor."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from lostmotion.detector.window import FloatArray, Window

__all__ = ["BEFORE_S", "Commanded", "smoothed"]

BEFORE_S = 0.2
"""The flank that is left is heard so long before the reversal [s]."""
COVERED = 0.7
"""Share of the stretch that commands must cover; what lies behind them is left out."""
FASTEST_HZ = 3.5
"""Commands are smoothed by polynomials that follow a motion up to this."""
MOST_POWERS = 20
"""Up to this degree powers serve, in a tenth of the time of the recursion; they lose six digits of sixteen there."""
RIDGE = 1e-9
"""Share of a coefficient's weight that is known to be 0: commands may come in bunches, which leave some unknown."""


@dataclass(frozen=True, slots=True, eq=False)
class Commanded:
    """theta_1 as a polynomial: coefficients and their covariance, over times mapped to -1..1."""

    middle: float
    half: float
    coefficients: FloatArray
    covariance: FloatArray

    @property
    def end(self) -> float:
        """Up to here it is known [s]."""
        return self.middle + self.half

    def basis(self, time: FloatArray) -> FloatArray:
        """Legendre's polynomials at times [s], shape (N, degree + 1)."""
        return _basis((time - self.middle) / self.half, len(self.coefficients) - 1)

    def acceleration(self, time: FloatArray) -> FloatArray:
        """theta_1'' [rad/s²] at times [s]."""
        degree = len(self.coefficients) - 1
        curved = _basis((time - self.middle) / self.half, degree - 2) @ (_curving(degree) @ self.coefficients)
        return np.asarray(curved / self.half**2)


def smoothed(times: FloatArray, commands: FloatArray, stretch: Window) -> Commanded | None:
    """The commands around the stretch as one polynomial, in seconds from its start; None when they do not cover it."""
    first, last = float(stretch.time[0]), float(stretch.time[-1])
    near = (times >= first - BEFORE_S) & (times <= last + BEFORE_S / 4)
    local, angle = times[near] - first, commands[near]
    length = last - first
    if local.size == 0 or local[0] > 0.05 * length or local[-1] < COVERED * length:
        return None
    middle, half = (local[-1] + local[0]) / 2, (local[-1] - local[0]) / 2
    degree = math.ceil(4 * FASTEST_HZ * half) + 5
    if local.size < 2 * degree:
        return None
    basis = _basis((local - middle) / half, degree)
    inverse = np.linalg.inv(basis.T @ basis + RIDGE * local.size * np.eye(degree + 1))
    coefficients = inverse @ (basis.T @ angle)
    left = angle - basis @ coefficients
    return Commanded(middle, half, coefficients, inverse * float(left @ left) / (local.size - degree - 1))


def _basis(place: FloatArray, degree: int) -> FloatArray:
    """Legendre's polynomials up to a degree at places -1..1, shape (N, degree + 1)."""
    if degree > MOST_POWERS:
        return np.asarray(np.polynomial.legendre.legvander(place, degree), np.float64)
    return np.asarray(np.vander(place, degree + 1, increasing=True) @ _powers(degree))


@lru_cache(maxsize=16)
def _powers(degree: int) -> FloatArray:
    """Legendre's polynomials by powers, a column each, shape (degree + 1, degree + 1)."""
    rows = [np.polynomial.legendre.leg2poly(unit[: k + 1]) for k, unit in enumerate(np.eye(degree + 1))]
    return np.column_stack([np.pad(row, (0, degree + 1 - row.size)) for row in rows])


@lru_cache(maxsize=16)
def _curving(degree: int) -> FloatArray:
    """Coefficients of the second derivative from those of a polynomial, shape (degree - 1, degree + 1)."""
    return np.asarray(np.polynomial.legendre.legder(np.eye(degree + 1), 2))
