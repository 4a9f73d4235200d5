"""A parabola through the last segment of a stream, sample by sample, at the samples' own times."""

from __future__ import annotations

import math
from collections import deque

__all__ = ["Curvature", "LocalFit"]

LEAST_POINTS = 5
LEAST_COVER = 0.8
"""Least share of the span that the samples cover."""
REANCHOR = 64
"""Samples after which the running sums are recomputed, so that rounding errors do not accumulate."""
NO_SUMS = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)

Curvature = tuple[float, float, float]
"""Time of a parabola (mean of the samples' times), its second derivative, and the standard deviation of that for
samples with independent errors of unit variance.  No class: one is made for each sample."""


class LocalFit:
    """Least-squares parabola over the samples of the last ``span`` seconds, by running sums: constant time a sample.

    The sums are of powers of t - anchor up to 4, and of those up to 2 times y - offset.
    """

    def __init__(self, span: float) -> None:
        self.span = span
        self._length = span * (1 + 1e-9)
        self.clear()

    def clear(self) -> None:
        """Forgets all samples."""
        self.samples: deque[tuple[float, float]] = deque()
        self._anchor = self._offset = 0.0
        self._age = REANCHOR
        self.sums = NO_SUMS

    def add(self, time: float, value: float) -> Curvature | None:
        """Takes a sample, later than all before; the curvature, or None while the span is not well covered."""
        samples = self.samples
        samples.append((time, value))
        self._age += 1
        if self._age > REANCHOR:
            self._reanchor()
        else:
            self._slide(time, value)
        if len(samples) < LEAST_POINTS or time - samples[0][0] < LEAST_COVER * self.span:
            return None
        return self._curvature()

    def stood(self, most: float, since: float) -> bool:
        """Whether the samples no older than ``since`` differ by at most so much; usually the last two decide."""
        high = low = self.samples[-1][1]
        for time, value in reversed(self.samples):
            if time < since:
                break
            if value > high:
                high = value
            elif value < low:
                low = value
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

    def _slide(self, time: float, value: float) -> None:
        """Takes the samples that have become too old out of the sums, and adds the newest."""
        samples, anchor, offset = self.samples, self._anchor, self._offset
        s1, s2, s3, s4, y0, y1, y2 = self.sums
        oldest = time - self._length
        while samples[0][0] < oldest:
            gone, was = samples.popleft()
            t, y = gone - anchor, was - offset
            t2 = t * t
            s1, s2, s3, s4, y0, y1, y2 = s1 - t, s2 - t2, s3 - t2 * t, s4 - t2 * t2, y0 - y, y1 - y * t, y2 - y * t2
        t, y = time - anchor, value - offset
        t2 = t * t
        self.sums = s1 + t, s2 + t2, s3 + t2 * t, s4 + t2 * t2, y0 + y, y1 + y * t, y2 + y * t2

    def _reanchor(self) -> None:
        """Begins the sums anew, with all samples that are not too old."""
        kept = self.samples
        oldest = kept[-1][0] - self._length
        while kept[0][0] < oldest:
            kept.popleft()
        self._anchor, self._offset = kept[-1]
        self._age = 0
        s1 = s2 = s3 = s4 = y0 = y1 = y2 = 0.0
        for time, value in kept:
            t, y = time - self._anchor, value - self._offset
            t2 = t * t
            s1, s2, s3, s4, y0, y1, y2 = s1 + t, s2 + t2, s3 + t2 * t, s4 + t2 * t2, y0 + y, y1 + y * t, y2 + y * t2
        self.sums = s1, s2, s3, s4, y0, y1, y2

    def _curvature(self) -> Curvature:
        """Normal equations in central moments c_k of the times; the parabola's part orthogonal to a line."""
        n = len(self.samples)
        m, s2, s3, s4, y0, y1, y2 = self.sums
        m /= n
        m2 = m * m
        c2 = s2 / n - m2
        c3 = (s3 - 3 * m * s2) / n + 2 * m * m2
        c4 = (s4 - 4 * m * s3 + 6 * m2 * s2) / n - 3 * m2 * m2
        skew = c3 / c2
        slope = y1 - m * y0
        bow = y2 - 2 * m * y1 + (m2 - c2) * y0
        spread = n * (c4 - c2 * c2 - skew * c3)
        return self._anchor + m, 2 * (bow - skew * slope) / spread, 2 / math.sqrt(spread)
