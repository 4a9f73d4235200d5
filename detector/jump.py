"""Jumps of a goal that is constant before and after."""

from __future__ import annotations

import math

from lostmotion.detector.local_fit import LocalFit

__all__ = ["JumpDetector"]

HOLD = 3
"""Samples for which the new goal must be constant; otherwise it is the start of a motion."""
STANDING = 0.25
"""A goal that changes by less than this share of the jump is constant."""
BEFORE = 0.5
"""Likewise for the half span before the jump; larger, as a slow motion may precede it."""


class JumpDetector:
    """Takes each sample before the local fit does; ``pending`` while a jump is not yet distinguished from a start."""

    def __init__(self, fit: LocalFit) -> None:
        self._fit = fit
        self.clear()

    def clear(self) -> None:
        """Forgets a pending jump."""
        self.pending = 0
        self._time = self._from = self._to = math.nan

    def add(self, time: float, value: float, least: float) -> tuple[float, float] | None:
        """Time [s] and height of a jump of at least ``least``, once, when the goal was constant for ``HOLD``
        samples."""
        if self.pending:
            change = self._to - self._from
            if abs(value - self._to) <= STANDING * abs(change):
                self.pending += 1
                return (self._time, change) if self.pending > HOLD else None
            self.pending = 0
        if self._fit.samples:
            last = self._fit.samples[-1][1]
            height = abs(value - last)
            if height >= least and self._fit.stood(BEFORE * height, time - 0.5 * self._fit.span):
                self.pending, self._time, self._from, self._to = 1, time, last, value
        return None
