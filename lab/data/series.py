"""Series of samples with gaps: NaN where not sampled."""

from __future__ import annotations

import numpy as np

from lostmotion.model.motion import FloatArray

__all__ = ["resolution", "rms", "runs"]


def resolution(values: FloatArray) -> float:
    """The smallest difference between two values that occur (N,); 0 for less than two values."""
    distinct = np.unique(values[np.isfinite(values)])
    steps = np.diff(distinct)
    steps = steps[steps > 1e-9 * np.max(np.abs(distinct), initial=0.0)]
    return float(steps.min()) if steps.size else 0.0


def rms(*parts: FloatArray) -> float:
    """Root mean square of all values that are not NaN."""
    return float(np.sqrt(np.nanmean(np.concatenate([part.ravel() for part in parts]) ** 2)))


def runs(x: FloatArray) -> list[slice]:
    """The segments of x (N,) without NaN."""
    finite = np.concatenate(([False], np.isfinite(x), [False]))
    edges = np.flatnonzero(finite[1:] != finite[:-1])
    return [slice(int(first), int(last)) for first, last in zip(edges[::2], edges[1::2], strict=True)]
