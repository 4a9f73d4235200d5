"""The noise level of a stream of angles, estimated from the stream; no thresholds here."""

from __future__ import annotations

import math
from bisect import bisect_left, insort
from collections import deque

__all__ = ["NoiseLevel"]

MEMORY = 100
"""Samples that the level is estimated from."""
SHARE = 0.6
"""Share of the smallest deviations, from which the usual one is estimated."""
TRIMMED_MEAN = 0.3965
"""Mean of the smallest 60 % of |x| for a normal x of unit variance."""
MEAN = 0.7979
"""Mean of |x| for the same."""
FAR = 3.0
"""Standard deviations at which a deviation is clipped."""


class NoiseLevel:
    """Standard deviation of the samples' independent errors, from the deviation of each from the line between its
    neighbours, over the last ``MEMORY`` samples.  Deviations far above the usual and above two quantisation steps are
    clipped, so that the edges of a staircase of goals are not taken for noise."""

    def __init__(self) -> None:
        self.level = 0.0
        self._sorted: list[float] = []
        self._recent: deque[float] = deque()
        self._sum = 0.0
        self.interrupt()

    def interrupt(self) -> None:
        """Marks a gap before the next sample; the level is kept."""
        self._t0 = self._y0 = self._t1 = self._y1 = math.nan

    def add(self, time: float, value: float, step: float) -> None:
        """Takes a sample, later than all before, of a stream quantised in ``step``."""
        share = (self._t1 - self._t0) / (time - self._t0)
        off = abs(self._y1 - self._y0 - share * (value - self._y0))
        self._t0, self._y0, self._t1, self._y1 = self._t1, self._y1, time, value
        if math.isnan(off):
            return
        off /= math.sqrt(1 + share * share + (1 - share) * (1 - share))
        insort(self._sorted, off)
        self._recent.append(off)
        self._sum += off
        if len(self._recent) > MEMORY:
            oldest = self._recent.popleft()
            del self._sorted[bisect_left(self._sorted, oldest)]
            self._sum -= oldest
        nothing_to_clip = self._sorted[-1] <= 2 * step  # as nearly always
        self.level = (self._sum / len(self._recent) if nothing_to_clip else self._clipped_mean(2 * step)) / MEAN

    def _clipped_mean(self, least: float) -> float:
        count = len(self._sorted)
        usual = math.ceil(SHARE * count)
        limit = max(least, FAR * sum(self._sorted[:usual]) / (usual * TRIMMED_MEAN))
        below = bisect_left(self._sorted, limit)
        return (sum(self._sorted[:below]) + (count - below) * limit) / count
