"""How much of what a device should deliver does not arrive, over the last half minute.  No clock, no I/O."""

from __future__ import annotations

from collections import deque

from lostmotion.detector.quality import LEAST_SHARE

__all__ = ["Losses"]

SPAN_S, LEAST_SPAN_S, MARK_S = 30.0, 10.0, 1.0
"""the segment that counts; the shortest; how far apart its marks are [s]"""
MOST = 1 - LEAST_SHARE
"""share that may be missing: windows with less are not scored"""
GONE = MOST / 2
"""a device that lost too much loses no more than this again"""


class Losses:
    """Two running counts of one device, expected and got, and whether the difference is too much."""

    def __init__(self) -> None:
        self._marks: deque[tuple[float, float, float]] = deque()
        self._reported = ""

    def clear(self) -> None:
        """The device was opened anew, or is not being read."""
        self._marks.clear()
        self._reported = ""

    def fault(self, time: float, expected: float, got: float) -> str:
        """The loss as text, "" while it is small; the counts are those since any start, at host time [s].

        The text does not change until the loss is over, because it is the reason of an alarm.
        """
        if not self._marks or time - self._marks[-1][0] >= MARK_S:
            self._marks.append((time, expected, got))
            while len(self._marks) > 1 and time - self._marks[1][0] > SPAN_S:
                self._marks.popleft()
        since, expected_then, got_then = self._marks[0]
        wanted = expected - expected_then
        if time - since < LEAST_SPAN_S or wanted <= 0:
            return self._reported
        share = 1 - (got - got_then) / wanted
        if share <= (GONE if self._reported else MOST):
            self._reported = ""
        elif not self._reported:
            self._reported = f"{share:.0%} of the samples were lost within {time - since:.0f} s"
        return self._reported
