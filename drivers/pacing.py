"""Pacing shared by simulated robots and replays: the speed of their time, and its start in UTC."""

from __future__ import annotations

import math
import time
from datetime import UTC, datetime

__all__ = ["Pace", "as_utc"]

STEP_S = 0.05  # of real time between two readings
LONGEST_STEP_S = 0.5  # of robot time in one reading, whatever the speed
LONGEST_SLEEP_S = 0.25


class Pace:
    """Robot time that runs ``speed`` times as fast as real time, or as fast as it is read (inf).

    It starts with the first wait.  Not thread-safe against a first wait in two threads at once, which only moves the
    start by that race.
    """

    def __init__(self, speed: float) -> None:
        self.speed = speed
        self._start: float | None = None

    @property
    def step(self) -> float:
        """The length of robot time [s] that one reading should bring."""
        return min(STEP_S * self.speed, LONGEST_STEP_S)

    def wait(self, robot_time: float) -> bool:
        """Sleeps until ``robot_time`` [s], but at most LONGEST_SLEEP_S; whether that time has come."""
        now = time.monotonic()
        if self._start is None:
            self._start = now
        missing = 0.0 if math.isinf(self.speed) else self._start + robot_time / self.speed - now
        if missing > 0:
            time.sleep(min(missing, LONGEST_SLEEP_S))
        return missing <= LONGEST_SLEEP_S


def as_utc(stamp: datetime) -> datetime:
    """A time in UTC; one without a zone is taken as UTC already."""
    return stamp.replace(tzinfo=UTC) if stamp.tzinfo is None else stamp.astimezone(UTC)
