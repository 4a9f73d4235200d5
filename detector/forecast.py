"""Forecast of the time at which a slow rise reaches a limit, under an unknown law of wear.  ``trend`` has slopes and
tests.

Wear may decelerate, be steady or accelerate, and months of scores seldom distinguish these.  So several laws are fitted
and weighted by their likelihoods; the result is the median and the spread over all of them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from lostmotion.detector.median import median, medians
from lostmotion.detector.window import FloatArray

__all__ = ["CONFIDENCE", "TimeToLimit", "forecast"]

CONFIDENCE = 0.8
"""Share of wear histories whose time lies within the interval."""
POWERS = (0.5, 0.7, 1.0, 1.4, 2.0, 2.8, 4.0)
RATES = (0.5, 1.0, 1.5, 2.2, 3.3)
"""Laws: a + b x^p and a + b (exp(r x) - 1), with x from 0 at the first score to 1 at the last."""
MOST, LEAST = 120, 12
"""Medians of so many runs are fitted; with fewer scores than LEAST there is no forecast."""
DRAWS = 1500
PLASTIC = 1.32471795724474602596
"""The real root of x³ = x + 1."""
FLOOR = 0.2
"""The noise grows with the value, but is at least as large as at this share of the median."""
CAUTION = 1.25
"""The correlation of a few dozen residuals is underestimated; found by back-tests (tests/detector/test_forecast.py)."""


@dataclass(frozen=True, slots=True)
class TimeToLimit:
    """Seconds from the last score until the limit: the middle, and the ends of an interval; inf for never."""

    likely: float
    earliest: float
    latest: float


def forecast(times: ArrayLike, values: ArrayLike, limit: float) -> TimeToLimit | None:
    """When the values, shape (N,) at ascending times [s], will reach the limit, median and 80 % interval; None for
    fewer than 12.

    Each law is fitted by least squares to medians, weighted by the noise, which is assumed to grow with the value; its
    covariance and likelihood use the effective number of correlated residuals (from the sum of their autocorrelations
    up to the first that is not positive).  The draws are fixed, so the result is reproducible.
    """
    time, value = _medians(np.asarray(times, dtype=float), np.asarray(values, dtype=float))
    if time.size < LEAST:
        return None
    span = float(time[-1] - time[0])
    x = (time - time[0]) / span
    smooth = np.vander(x, 3)
    size = np.maximum(smooth @ np.linalg.lstsq(smooth, value, rcond=None)[0], FLOOR * median(value))
    fits = [_Fit.of(law, x, value, size) for law in _laws()]
    worth = _inflation(min(fits, key=lambda fit: float(fit.left @ fit.left)).left)
    logs = np.array([-time.size / 2 / worth * np.log(fit.variance) for fit in fits])
    weights = np.exp(logs - logs.max())
    normal = _normal_pairs(DRAWS)
    crossings = np.concatenate([fit.crossings(limit, worth, normal) for fit in fits])
    waits = np.maximum(crossings - 1.0, 0.0) * span
    order = np.argsort(waits)
    share = np.cumsum(np.repeat(weights / weights.sum() / DRAWS, DRAWS)[order])
    tail = (1 - CONFIDENCE) / 2
    ends = np.minimum(np.searchsorted(share, (0.5, tail, 1 - tail)), waits.size - 1)
    likely, earliest, latest = waits[order][ends]
    return TimeToLimit(float(likely), float(earliest), float(latest))


def _normal_pairs(count: int) -> FloatArray:
    """Draws of two independent normal variables, shape (count, 2), always the same, and more even than random ones:
    the additive recurrence in two dimensions (Roberts 2018) by Box and Muller's transform.  NumPy's generators would
    bring six megabytes to the service."""
    index = np.arange(1, count + 1)[:, None]
    even = (0.5 + index * np.array([1.0, PLASTIC]) / PLASTIC**2) % 1.0
    radius, turn = np.sqrt(-2 * np.log(even[:, :1])), 2 * np.pi * even[:, 1:]
    return np.asarray(radius * np.hstack([np.cos(turn), np.sin(turn)]))


@dataclass(frozen=True, slots=True, eq=False)
class _Law:
    """A rising shape f with f(0) = 0, and its inverse."""

    shape: Callable[[FloatArray], FloatArray]
    inverse: Callable[[FloatArray], FloatArray]


def _laws() -> list[_Law]:
    powers = [_Law(lambda x, p=p: x**p, lambda f, p=p: f ** (1 / p)) for p in POWERS]  # type: ignore[misc]
    rates = [_Law(lambda x, r=r: np.expm1(r * x), lambda f, r=r: np.log1p(f) / r) for r in RATES]  # type: ignore[misc]
    return [*powers, *rates]


@dataclass(frozen=True, slots=True, eq=False)
class _Fit:
    """a and b of one law, their covariance for unit variance, and the weighted residuals."""

    law: _Law
    line: FloatArray
    covariance: FloatArray
    left: FloatArray

    @classmethod
    def of(cls, law: _Law, x: FloatArray, value: FloatArray, size: FloatArray) -> _Fit:
        """Weighted least squares."""
        columns = np.column_stack([np.ones(x.size), law.shape(x)]) / size[:, None]
        inverse = np.asarray(np.linalg.inv(columns.T @ columns), dtype=np.float64)
        line = inverse @ (columns.T @ (value / size))
        return cls(law, line, inverse, value / size - columns @ line)

    @property
    def variance(self) -> float:
        """Of the weighted residuals; never 0, as it is a divisor."""
        return float(self.left @ self.left) / (self.left.size - 3) + 1e-12

    def crossings(self, limit: float, worth: float, normal: FloatArray) -> FloatArray:
        """x at which draws of the line reach the limit; 0 when they are above it, inf when they fall."""
        a, b = (self.line + normal @ np.linalg.cholesky(self.covariance * self.variance * worth).T).T
        rises = b > 0
        height = np.maximum(limit - a, 0.0) / np.where(rises, b, 1.0)
        return np.where(rises, self.law.inverse(height), np.where(limit <= a, 0.0, np.inf))


def _medians(time: FloatArray, value: FloatArray) -> tuple[FloatArray, FloatArray]:
    there = np.isfinite(time) & np.isfinite(value)
    time, value = time[there], value[there]
    if time.size < LEAST or time[-1] <= time[0]:
        return np.empty(0), np.empty(0)
    ends = np.linspace(0, time.size, min(time.size, MOST) + 1).astype(int)
    return medians(time, ends), medians(value, ends)


def _inflation(left: FloatArray) -> float:
    """Number of correlated residuals per independent one, times CAUTION."""
    power = float(left @ left)
    if power < 1e-9 * left.size:  # a line without noise
        return CAUTION
    total = 1.0
    for lag in range(1, left.size // 4):
        correlation = float(left[lag:] @ left[:-lag]) / power
        if correlation <= 0:
            break
        total += 2 * correlation
    return CAUTION * total
