"""The size of the play as a value with its interval, and that of many windows together.  No samples, no commands."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lostmotion.detector.median import weighted_quantile
from lostmotion.detector.window import FloatArray

__all__ = ["PlaySize", "Z", "pooled", "unknown"]

Z = 1.959964
"""Standard deviations at the ends of a 95 % interval."""


@dataclass(frozen=True, slots=True)
class PlaySize:
    """Lost motion at the joint [rad] with the ends of its 95 % interval; all NaN where reason says why not."""

    value: float
    low: float
    high: float
    reason: str = ""


def pooled(values: Sequence[float] | FloatArray, halves: Sequence[float] | FloatArray | None = None) -> PlaySize:
    """The play [rad] that many windows tell together, with its 95 % interval (needs 6 windows).

    values: the plays of the windows [rad], NaN where a window tells none; halves: half of their own intervals [rad],
    None where nothing is known of them.

    The value is the median, each window weighted by 1 / half (``median.weighted_quantile``).  The interval lies between
    the values at 1/2 +- z |w|_2 / (2 |w|_1) of the weight, which is the binomial interval of a median where all weights
    are alike.  What is uncertain in all windows alike, as the gear's stiffness, is at most the tenth of the halves that
    are narrowest, and is added.
    """
    plays = np.asarray(values, dtype=float)
    own = np.ones_like(plays) if halves is None else np.asarray(halves, dtype=float)
    known = np.isfinite(plays) & np.isfinite(own)
    if (count := int(known.sum())) < 6:
        return unknown(f"{count} windows tell a play; expected at least 6")
    plays, own = plays[known], own[known]
    weight = 1 / np.maximum(own, 1e-12)
    reach = Z * float(np.linalg.norm(weight)) / (2 * float(weight.sum()))
    low, middle, high = (weighted_quantile(plays, weight, share) for share in (0.5 - reach, 0.5, 0.5 + reach))
    common = 0.0 if halves is None else float(np.quantile(own, 0.1))
    return PlaySize(
        middle, max(middle - math.hypot(middle - low, common), 0.0), middle + math.hypot(high - middle, common)
    )


def unknown(reason: str) -> PlaySize:
    """No play is told, and why."""
    return PlaySize(math.nan, math.nan, math.nan, reason)
