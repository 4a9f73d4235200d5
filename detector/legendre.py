"""Legendre's polynomials P_0 to P_n on -1..1: values and derivatives.  The checks of NumPy's package of polynomials
take as long as the computation for a window, and a megabyte."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from lostmotion.detector.window import FloatArray

__all__ = ["derivative", "scaled_values", "values"]


def values(place: FloatArray, degree: int) -> FloatArray:
    """P_0 to P_degree at places (N,), shape (N, degree + 1), by Bonnet's recurrence."""
    rows = np.empty((degree + 1, np.size(place)))
    rows[0] = 1.0
    if degree:
        rows[1] = place
    for k in range(2, degree + 1):
        row = np.multiply(place, rows[k - 1], out=rows[k])  # P_k = x P_(k-1) + (k - 1) / k (x P_(k-1) - P_(k-2))
        row += (k - 1) / k * (row - rows[k - 2])
    return rows.T


def scaled_values(place: FloatArray, degree: int) -> FloatArray:
    """The same with a mean square of 1, shape (N, degree + 1)."""
    return np.asarray(values(place, degree) * np.sqrt(2 * np.arange(degree + 1) + 1))


@lru_cache(maxsize=32)
def derivative(degree: int, order: int) -> FloatArray:
    """Matrix from a series' coefficients to those of its derivative of that order, shape (degree + 1 - order, degree +
    1): P_j' is the sum of (2 k + 1) P_k over k = j - 1, j - 3, ..."""
    matrix = np.eye(degree + 1)
    for size in range(degree, degree - order, -1):
        k, j = np.arange(size)[:, None], np.arange(size + 1)
        matrix = np.where((j > k) & ((j - k) % 2 == 1), 2.0 * k + 1, 0.0) @ matrix
    return matrix
