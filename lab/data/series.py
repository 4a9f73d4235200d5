"""Series of samples with gaps: NaN where not sampled."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from lostmotion.model.motion import FloatArray

__all__ = ["direction", "is_onward", "resolution", "rms", "runs", "seen"]

PLACES, ONWARD = 100, 0.9
"""Number of samples of an angle, and the least share of the distance between them that leads onward: a shaft that turns
back by a tenth does not coast."""


def seen(values: FloatArray) -> FloatArray:
    """The values (N,) that were read."""
    return np.asarray(values[np.isfinite(values)])


def is_onward(position: FloatArray) -> bool:
    """Whether a position (N,) changes in one direction.  It is compared at a hundred samples, as noise reverses between
    neighbours."""
    position = seen(position)
    steps = np.diff(position[np.linspace(0, position.size - 1, PLACES).astype(int)])
    return abs(float(steps.sum())) > ONWARD * float(np.abs(steps).sum())


def direction(positions: Iterable[FloatArray]) -> float:
    """The direction in which all positions (N,) change, 1.0 or -1.0; 0.0 if they change in both."""
    ways = {float(np.sign(one[-1] - one[0])) if is_onward(one) else 0.0 for one in map(seen, positions)}
    return ways.pop() if len(ways) == 1 else 0.0


def resolution(values: FloatArray) -> float:
    """The smallest difference between two values that occur (N,); 0 for less than two values."""
    distinct = np.unique(seen(values))
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
