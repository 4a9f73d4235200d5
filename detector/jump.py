"""A goal that stood, jumped between two samples, and stands again."""

from __future__ import annotations

import math

from lostmotion.detector.local_fit import LocalFit

__all__ = ["JumpDetector"]

HOLD = 3
"""Samples for which the new goal must stand, or else it is the start of a motion."""
STANDING = 0.25
"""A goal that changes by less than this share of the jump stands."""
BEFORE = 0.5
"""Likewise for the half span before the jump; more, for a slow motion may precede it."""


class JumpDetector:
    """Looks at each sample before the local fit takes it; ``pending`` while it cannot yet tell a jump from a start."""

    def __init__(self, fit: LocalFit) -> None:
        self._fit = fit
        self.clear()

    def clear(self) -> None:
        """Forgets a pending jump."""
        self.pending = 0
        self._time = self._from = self._to = math.nan

    def add(self, time: float, value: float, least: float) -> tuple[float, float] | None:
        """Time [s] and height of a jump of at least ``least``, once, when it has stood for ``HOLD`` samples."""
        if self.pending:
            change = self._to - self._from
            if abs(value - self._to) <= STANDING * abs(change):
                self.pending += 1
                return (self._time, change) if self.pending > HOLD else None
            self.pending = 0
        if self._fit.samples:
            last = self._fit.samples[-1][1]
            height = abs(value - last)
            if height >= least and BEFORE * height >= self._fit.reach(time - 0.5 * self._fit.span):
                self.pending, self._time, self._from, self._to = 1, time, last, value
        return None
