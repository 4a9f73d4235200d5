"""Removes the dependence of a slow series on motion and temperature, and keeps its wear.  ``trend`` has slopes."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from lostmotion.detector.median import median, medians
from lostmotion.detector.window import FloatArray

__all__ = ["normalised"]

PIECES, LEAST_POINTS = 20, 20
"""Wear is assumed to be constant within a piece: number of pieces, and least points of one."""
CLIP = 3.0
"""Robust standard deviations at which outliers of a piece are clipped."""
SIGNIFICANT = 5.0
"""A dependence is used from so many standard errors on; by chance, one series in a million has one."""
PRESENT = 0.5
"""Least share of the points with a quantity for it to be used."""


def normalised(values: FloatArray, quantities: Mapping[str, FloatArray]) -> tuple[FloatArray, dict[str, float]]:
    """The values, shape (N,), as they would be at the median of each quantity, (N,); and the dependences found.

    The values are taken as f(t) exp(sum of b_k x_k).  In each of up to 20 runs of neighbouring points the medians of ln
    value and of x are subtracted, and b is estimated by least squares from the residuals: wear, a repair or another job
    between runs has no effect on it.  Dependences below five standard errors are not corrected, nor points with a
    quantity that is not finite, nor values that are not positive.
    """
    usable = values > 0
    known = {
        name: x for name, x in quantities.items()
        if np.mean(np.isfinite(x)) >= PRESENT and np.ptp(x[np.isfinite(x)]) > 0
    }  # fmt: skip
    every = usable & np.logical_and.reduce([np.isfinite(x) for x in known.values()], initial=True)
    while known:
        columns = np.column_stack([x[every] for x in known.values()])
        slopes, errors = _dependence(np.log(values[every]), columns)
        clear = np.abs(slopes) > SIGNIFICANT * errors
        if clear.all():
            break
        known = {name: x for (name, x), stays in zip(known.items(), clear, strict=True) if stays}
    if not known:
        return values, {}
    result = values.copy()
    for slope, x in zip(slopes, known.values(), strict=True):
        there = np.isfinite(x)
        result[there] *= np.exp(-slope * (x[there] - median(x[there])))
    return result, dict(zip(known, slopes.tolist(), strict=True))


def _dependence(value: FloatArray, columns: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Slopes and their standard errors, shape (K,); infinite errors where they cannot be estimated."""
    count, many = columns.shape
    pieces = min(count // LEAST_POINTS, PIECES)
    if pieces == 0:
        return np.zeros(many), np.full(many, math.inf)
    ends = np.linspace(0, count, pieces + 1).astype(int)
    left, *others = (x - np.repeat(medians(x, ends), np.diff(ends)) for x in (value, *columns.T))
    centred = np.column_stack(others)
    slopes = np.zeros(many)
    for _ in range(3):  # outliers are clipped
        rest = left - centred @ slopes
        spread = 1.4826 * median(np.abs(rest)) + 1e-12
        inverse = np.linalg.pinv(centred.T @ centred)
        slopes = slopes + inverse @ (centred.T @ np.clip(rest, -CLIP * spread, CLIP * spread))
    rest = left - centred @ slopes
    clipped = np.clip(rest, -CLIP * spread, CLIP * spread)
    variance = float(clipped @ clipped) / max(count - pieces - many, 1)
    errors = np.sqrt(variance * np.diag(inverse))
    return slopes, np.where(errors > 0, errors, math.inf)
