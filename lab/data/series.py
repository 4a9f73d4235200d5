"""Series of samples with gaps: NaN where not sampled."""

from __future__ import annotations

import numpy as np

from lostmotion.model.motion import FloatArray

__all__ = ["rms", "runs"]


def rms(*parts: FloatArray) -> float:
    """Root mean square of all values that are not NaN."""
    return float(np.sqrt(np.nanmean(np.concatenate([part.ravel() for part in parts]) ** 2)))


def runs(x: FloatArray) -> list[slice]:
    """The segments of x (N,) without NaN."""
    finite = np.concatenate(([False], np.isfinite(x), [False]))
    edges = np.flatnonzero(finite[1:] != finite[:-1])
    return [slice(int(first), int(last)) for first, last in zip(edges[::2], edges[1::2], strict=True)]
