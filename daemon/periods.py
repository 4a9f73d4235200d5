"""What is done every so often in a loop that wakes at any time."""

from __future__ import annotations

import time

__all__ = ["Periods"]


class Periods:
    """Periods [s], each of which is due for the first time after itself."""

    def __init__(self, *periods_s: float) -> None:
        now = time.monotonic()
        self._due = {period_s: now + period_s for period_s in periods_s}

    def is_due(self, period_s: float) -> bool:
        """Whether that period has passed since it was due last."""
        now = time.monotonic()
        if now < self._due[period_s]:
            return False
        self._due[period_s] = now + period_s
        return True
