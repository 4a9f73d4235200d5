"""The commands around a stretch of acceleration as one smooth motion that can be differentiated.  Knows no sensor."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from lostmotion.detector.window import FloatArray, Window

__all__ = ["BEFORE_S", "Commanded", "smoothed"]

BEFORE_S = 0.2
"""The flank that is left is heard so long before the reversal [s]."""
COVERED = 0.7
"""Share of the stretch that commands must cover; what lies behind them is left out."""
FASTEST_HZ = 3.5
"""Commands are smoothed by polynomials that follow a motion up to this."""


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
        degree = len(self.coefficients) - 1
        return np.asarray(np.polynomial.legendre.legvander((time - self.middle) / self.half, degree), np.float64)

    def acceleration(self, time: FloatArray) -> FloatArray:
        """theta_1'' [rad/s²] at times [s]."""
        curved = np.polynomial.legendre.legder(self.coefficients, 2)
        return np.asarray(np.polynomial.legendre.legval((time - self.middle) / self.half, curved) / self.half**2)


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
    basis = np.polynomial.legendre.legvander((local - middle) / half, degree)
    inverse = np.linalg.pinv(basis.T @ basis)  # commands may come in bunches
    coefficients = inverse @ (basis.T @ angle)
    left = angle - basis @ coefficients
    return Commanded(middle, half, coefficients, inverse * float(left @ left) / (local.size - degree - 1))
