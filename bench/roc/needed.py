"""The signal-to-noise ratio from which a statistic finds enough, and how well that is known.  Knows no signal."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lostmotion.detector.window import FloatArray

__all__ = ["FALSE_ALARM", "FOUND", "Needed", "crossing", "needed", "shown"]

FALSE_ALARM, FOUND = 0.01, 0.9
DRAWS = 100


@dataclass(frozen=True)
class Needed:
    """db: SNR [dB] for 90 % found at 1 % false alarms, NaN where the largest that was tried does not do; error: its
    standard deviation over bootstrap draws of healthy windows and of motions."""

    db: float
    error: float


def needed(healthy: FloatArray, worn: FloatArray, db: FloatArray, motion: NDArray[np.intp]) -> Needed:
    """healthy: scores, shape (M,), or (D, M) where they depend on the SNR; worn: (D, M) at db, (D,); motion: from which
    motion each column of worn is, whole motions are drawn together."""
    rng = np.random.default_rng(1)
    healthy = np.broadcast_to(healthy, (len(db), healthy.shape[-1]))
    counts = np.bincount(motion)
    one = crossing(_found(healthy, worn, motion, np.ones(counts.size)), db)
    draws = []
    for _ in range(DRAWS):
        drawn = healthy[:, rng.integers(healthy.shape[1], size=healthy.shape[1])]
        weights = np.bincount(rng.choice(np.flatnonzero(counts), np.count_nonzero(counts)), minlength=counts.size)
        draws.append(crossing(_found(drawn, worn, motion, weights), db))
    finite = [value for value in draws if math.isfinite(value)]
    return Needed(one, float(np.std(finite)) if len(finite) > DRAWS / 2 else math.nan)


def crossing(found: FloatArray, db: FloatArray) -> float:
    """SNR [dB] from which the share stays above FOUND; NaN when it does not get there."""
    below = np.flatnonzero(found < FOUND)
    if below.size == 0:
        return float(db[0])
    i = int(below[-1])
    if i + 1 >= db.size:
        return math.nan
    return float(db[i] + (db[i + 1] - db[i]) * (FOUND - found[i]) / (found[i + 1] - found[i]))


def shown(value: Needed, top: float) -> str:
    """``14.5 ±0.1``, or that the largest SNR does not do."""
    if math.isnan(value.db):
        return f"> {top:g}"
    return f"{value.db:.1f}" + (f" ±{value.error:.1f}" if math.isfinite(value.error) else "")


def _found(
    healthy: FloatArray, worn: FloatArray, motion: NDArray[np.intp], weights: NDArray[np.float64 | np.intp]
) -> FloatArray:
    """Share of the worn scores above the level that FALSE_ALARM of the healthy ones exceed, at each SNR."""
    above = worn > np.quantile(healthy, 1 - FALSE_ALARM, axis=1)[:, None]
    weight = weights[motion]
    return np.asarray(above @ weight / weight.sum())
