"""The size of the play as a value with its interval, and pooled over many windows.  No samples, no commands."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lostmotion.detector.median import weighted_quantile
from lostmotion.detector.window import FloatArray

__all__ = ["NO_EVIDENCE", "PlayEvidence", "PlaySize", "Z", "pooled", "unknown"]

Z = 1.959964
"""Standard deviations at the ends of a 95 % interval."""
COMMON = 0.4
"""Standard deviation of the error common to all windows, as a share of a window's own.  With 0.25, 0.35, 0.4 and 0.5,
91, 89, 88 and 86 % of the windows above 30 dB give a size; of 2748 windows of healthy joints 25, 7, 3 and 1 do, most
of them under trapezoids.  With each value 97 % of the intervals hold (40 joints of ``bench.outside``, seeds 7000 to
7117, and 45 of seeds 9000 to 9116 without their play)."""
MEMORY = 0.95
"""Weight of earlier windows after each window: plays grow, motions change.  With COMMON = 0.5, values of 0.8, 0.95 and
0.99 give a size in 85, 86 and 87 % of those windows, and in 7, 1 and 1 healthy ones."""


@dataclass(frozen=True, slots=True)
class PlaySize:
    """Lost motion at the joint [rad] with the ends of its 95 % interval; all NaN where ``reason`` is given."""

    value: float
    low: float
    high: float
    reason: str = ""


@dataclass(frozen=True, slots=True)
class PlayEvidence:
    """The evidence of play in all windows of a joint so far: sums over windows of weight times play [1/rad], of the
    weights 1 / variance [1/rad²], and of 1, the number of windows.

    Windows selected because their own estimate is large would be biased upwards; the mean of all windows has no
    selection.
    """

    weighted_sum: float = 0.0
    weight: float = 0.0
    windows: float = 0.0

    @property
    def is_significant(self) -> bool:
        """Whether the mean is above 0 by more than chance and a common error explain."""
        if not self.weight:
            return False
        return self.weighted_sum / self.weight > Z * math.sqrt((1 + COMMON**2 * self.windows) / self.weight)

    def updated(self, play: float, deviation: float) -> PlayEvidence:
        """The evidence after one more window, which estimates a play [rad] with that standard deviation."""
        weight = deviation**-2
        return PlayEvidence(
            MEMORY * self.weighted_sum + weight * play, MEMORY * self.weight + weight, MEMORY * self.windows + 1
        )


NO_EVIDENCE = PlayEvidence()
"""Before the first window."""


def pooled(values: Sequence[float] | FloatArray, halves: Sequence[float] | FloatArray | None = None) -> PlaySize:
    """The play [rad] pooled over many windows, with its 95 % interval (needs 6 windows).

    values: the plays of the windows [rad], NaN where a window gives none; halves: half-widths of their intervals [rad],
    None where these are unknown.

    The value is the median, each window weighted by 1 / half (``median.weighted_quantile``).  The interval lies between
    the values at 1/2 +- z |w|_2 / (2 |w|_1) of the weight, which is the binomial interval of a median where all weights
    are alike.  A common uncertainty of all windows, such as the gear's stiffness, is bounded by the 10 % quantile of
    the halves, which is added.
    """
    plays = np.asarray(values, dtype=float)
    own = np.ones_like(plays) if halves is None else np.asarray(halves, dtype=float)
    known = np.isfinite(plays) & np.isfinite(own)
    if (count := int(known.sum())) < 6:
        return unknown(f"{count} windows with a size of the play; expected at least 6")
    plays, own = plays[known], own[known]
    weight = 1 / np.maximum(own, 1e-12)
    reach = Z * float(np.linalg.norm(weight)) / (2 * float(weight.sum()))
    low, middle, high = (weighted_quantile(plays, weight, share) for share in (0.5 - reach, 0.5, 0.5 + reach))
    common = 0.0 if halves is None else float(np.quantile(own, 0.1))
    return PlaySize(
        middle, max(middle - math.hypot(middle - low, common), 0.0), middle + math.hypot(high - middle, common)
    )


def unknown(reason: str) -> PlaySize:
    """No estimate, and the reason."""
    return PlaySize(math.nan, math.nan, math.nan, reason)
