"""A parabola through the last segment of a stream, sample by sample, at the samples' own times."""

from __future__ import annotations

import math
from collections import deque
from typing import NamedTuple

__all__ = ["Curvature", "LocalFit"]

LEAST_POINTS = 5
LEAST_COVER = 0.8
"""Least share of the span that the samples cover."""
REANCHOR = 64
"""Samples after which the running sums are recomputed, so that rounding errors do not accumulate."""
NO_SUMS = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


class Curvature(NamedTuple):
    """Second derivative of the parabola, its time (mean of the samples' times) and its standard deviation for samples
    with independent errors of unit variance."""

    time: float
    value: float
    gain: float


class LocalFit:
    """Least-squares parabola over the samples of the last ``span`` seconds, by running sums: constant time a sample.

    The sums are of powers of t - anchor up to 4, and of those up to 2 times y - offset.
    """

    def __init__(self, span: float) -> None:
        self.span = span
        self.clear()

    def clear(self) -> None:
        """Forgets all samples."""
        self.samples: deque[tuple[float, float]] = deque()
        self._anchor = self._offset = 0.0
        self._age = REANCHOR
        self._sums = NO_SUMS

    def add(self, time: float, value: float) -> Curvature | None:
        """Takes a sample, later than all before; the curvature, or None while the span is not well covered."""
        samples = self.samples
        samples.append((time, value))
        self._age += 1
        oldest = time - self.span * (1 + 1e-9)
        while samples[0][0] < oldest:
            self._count(*samples.popleft(), -1.0)
        self._count(time, value, 1.0)
        if self._age > REANCHOR:
            self._reanchor()
        if len(samples) < LEAST_POINTS or time - samples[0][0] < LEAST_COVER * self.span:
            return None
        return self._curvature()

    def stood(self, most: float, since: float) -> bool:
        """Whether the samples no older than ``since`` differ by at most so much; usually the last two decide."""
        high, low = -math.inf, math.inf
        for time, value in reversed(self.samples):
            if time < since:
                break
            high, low = max(high, value), min(low, value)
            if high - low > most:
                return False
        return True

    def moves(self, least: float) -> bool:
        """Whether samples differ by at least so much; usually the first and the last suffice."""
        samples = self.samples
        if abs(samples[-1][1] - samples[0][1]) >= least:
            return True
        values = [value for _, value in samples]
        return max(values) - min(values) >= least

    def _reanchor(self) -> None:
        self._anchor, self._offset = self.samples[-1]
        self._age = 0
        self._sums = NO_SUMS
        for time, value in self.samples:
            self._count(time, value, 1.0)

    def _count(self, time: float, value: float, sign: float) -> None:
        """Adds a sample (1) to the sums, or removes it (-1)."""
        s1, s2, s3, s4, y0, y1, y2 = self._sums
        t = time - self._anchor
        t2 = t * t
        y = sign * (value - self._offset)
        square = sign * t2
        self._sums = s1 + sign * t, s2 + square, s3 + square * t, s4 + square * t2, y0 + y, y1 + y * t, y2 + y * t2

    def _curvature(self) -> Curvature:
        """Normal equations in central moments c_k of the times; the parabola's part orthogonal to a line."""
        n = len(self.samples)
        m, s2, s3, s4, y0, y1, y2 = self._sums
        m /= n
        m2 = m * m
        c2 = s2 / n - m2
        c3 = (s3 - 3 * m * s2) / n + 2 * m * m2
        c4 = (s4 - 4 * m * s3 + 6 * m2 * s2) / n - 3 * m2 * m2
        skew = c3 / c2
        slope = y1 - m * y0
        bow = y2 - 2 * m * y1 + (m2 - c2) * y0
        spread = n * (c4 - c2 * c2 - skew * c3)
        return Curvature(self._anchor + m, 2 * (bow - skew * slope) / spread, 2 / math.sqrt(spread))
