"""Change points of a slow series in level or slope."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from lostmotion.detector.errors import DetectorError
from lostmotion.detector.median import medians
from lostmotion.detector.window import FloatArray

__all__ = ["change_points"]

MOST = 500
"""Longer series are first replaced by the medians of as many runs."""
SHORTEST = 5
"""Least points of a piece."""
PENALTY = 5.0
"""Penalty of one more piece, in variances times log N; calibrated on noise, see tests/detector/test_changes.py."""
CLIP = 3.0
"""Standard deviations off the running median beyond which a point is an outlier and is clipped."""
MAD = 1.4826 / np.sqrt(2)
"""Standard deviation of a normal series from the median absolute difference of its neighbours."""


def change_points(y: ArrayLike) -> list[int]:
    """Indices at which a new piece begins, ascending; [] when one line explains the series.

    y: shape (N,), in time order, NaN left out of account (their indices count).  The pieces are lines, found by optimal
    partitioning (Jackson et al. 2005) of the squared error with a penalty for each piece.  The noise is that of the
    differences between neighbours and next neighbours, from which its serial correlation is estimated too.
    """
    values = np.asarray(y, dtype=float)
    if values.ndim != 1:
        raise DetectorError(f"an array of {values.ndim} dimensions; expected a series")
    there = np.flatnonzero(np.isfinite(values))
    if there.size < 2 * SHORTEST:
        return []
    ends = np.linspace(0, there.size, min(there.size, MOST) + 1).astype(int)
    series = medians(values[there], ends)
    variance, correlation = _noise(series)
    if variance == 0:
        return []
    calm = _without_outliers(series, np.sqrt(variance))
    price = PENALTY * np.log(series.size) * variance * (1 + correlation) / (1 - correlation)
    return [int(there[ends[start]]) for start in _partition(calm, price)]


def _noise(series: FloatArray) -> tuple[float, float]:
    """Variance and lag-one correlation of a first-order process, insensitive to slow changes and rare jumps."""
    near, far = (MAD * float(np.median(np.abs(series[lag:] - series[:-lag]))) for lag in (1, 2))
    if near == 0:
        return float(np.var(np.diff(series))) / 2, 0.0
    # Var of differences: 2 s² (1 - r) between neighbours, 2 s² (1 - r²) between next neighbours.
    correlation = min(max((far / near) ** 2 - 1, 0.0), 0.9)
    return near**2 / (1 - correlation), correlation


def _without_outliers(series: FloatArray, sigma: float) -> FloatArray:
    padded = np.pad(series, 5, mode="reflect")
    smooth = np.median(np.lib.stride_tricks.sliding_window_view(padded, 11), axis=1)
    return np.asarray(smooth + np.clip(series - smooth, -CLIP * sigma, CLIP * sigma))


def _partition(series: FloatArray, price: float) -> list[int]:
    """Starts of the pieces after the first in the cheapest partition into lines."""
    n = series.size
    x = np.linspace(-1, 1, n)
    y = series - series.mean()
    sums = np.zeros((6, n + 1))
    sums[:, 1:] = np.cumsum([np.ones(n), x, x * x, y, x * y, y * y], axis=1)
    cost = np.full(n + 1, np.inf)
    cost[0] = -price
    origin = np.zeros(n + 1, dtype=int)
    for end in range(SHORTEST, n + 1):
        starts = np.arange(end - SHORTEST + 1)
        total = cost[starts] + price + _line_errors(sums[:, end, None] - sums[:, starts])
        origin[end] = int(np.argmin(total))
        cost[end] = total[origin[end]]
    found = []
    at = int(origin[n])
    while at > 0:
        found.append(at)
        at = int(origin[at])
    return found[::-1]


def _line_errors(sums: FloatArray) -> FloatArray:
    """Squared error left by a line, from the sums of 1, x, x², y, xy, y² over each piece; shape (6, M) to (M,)."""
    n, x, xx, y, xy, yy = sums
    across = xx - x * x / n
    along = xy - x * y / n
    return np.asarray(np.maximum(yy - y * y / n - along * along / across, 0.0))
