"""The time of a robot: seconds on a clock that never steps, and how they map to UTC.

Every sample carries robot time.  On hardware that is the host's monotonic clock; a simulated robot and a replay bring a
clock of their own, which may run faster.  UTC is made from it only at the edge, where a score or an alarm is written.
"""

from __future__ import annotations

import ctypes
import threading
import time
from datetime import UTC, datetime, timedelta
from functools import lru_cache
from typing import Protocol

__all__ = ["CYCLE_S", "Clock", "SystemClock", "VirtualClock", "is_synchronised", "next_cycle", "wall"]

CYCLE_S = 0.2
"""hardware is read, and its windows are scored, in cycles that begin at multiples of this robot time [s], if ``[robot]
cycle_s`` does not say otherwise.  Each wake-up of a thread costs as much as a score; docs/reliability.md has the
measurement"""

SAME_S = 1e-6
"""times that are so close are the same [s], as they differ by rounding: 1.2 // 0.2 is 5, and 6 * 0.2 is later than 1.2.
A clock that has run for 1e7 s rounds to 2e-9 s; the shortest cycle is 5 ms (test_clock)"""

TIMEX_BYTES = 1024
"""more than a struct timex has"""
UNSYNCHRONISED = 5
"""TIME_ERROR of adjtimex(2)"""

wall = time.time
"""the system's clock [s since 1970], looked up here by those who stamp rows, so that a test can set it"""


def next_cycle(now: float, length: float = CYCLE_S) -> float:
    """When the next cycle begins [s], after ``now`` [s], of cycles of so many seconds."""
    return ((now + SAME_S) // length + 1) * length


def is_synchronised() -> bool:
    """Whether, by the kernel, network time has set the system's clock."""
    return bool(_libc().adjtimex(ctypes.create_string_buffer(TIMEX_BYTES)) != UNSYNCHRONISED)


@lru_cache(maxsize=1)
def _libc() -> ctypes.CDLL:
    return ctypes.CDLL(None)


class Clock(Protocol):
    """Robot time [s], the length of the cycles in which hardware is read [s], and the time's place in UTC."""

    @property
    def cycle_s(self) -> float: ...

    def now(self) -> float:
        """The current robot time [s]; never runs backwards."""
        ...

    def utc(self, robot_time: float) -> datetime:
        """The UTC of a robot time [s]."""
        ...


class SystemClock:
    """The host's monotonic clock; UTC by the offset that holds when it is asked, so a step of the system's clock moves
    the stamps from then on and nothing else."""

    now = staticmethod(time.monotonic)

    def __init__(self, cycle_s: float = CYCLE_S) -> None:
        self.cycle_s = cycle_s

    def utc(self, robot_time: float) -> datetime:
        return datetime.fromtimestamp(wall() - time.monotonic() + robot_time, UTC)


class VirtualClock:
    """The time of a simulated robot or a replay, advanced by its driver.

    ``start`` is the UTC of robot time 0.
    """

    cycle_s = CYCLE_S

    def __init__(self, start: datetime) -> None:
        self._start = start.astimezone(UTC)
        self._now = 0.0
        self._lock = threading.Lock()

    def begin(self, start: datetime) -> None:
        """Sets the UTC of robot time 0, before the robot moves."""
        self._start = start.astimezone(UTC)

    def advance(self, robot_time: float) -> None:
        """Moves the clock to ``robot_time`` [s]; a time in the past leaves it where it is."""
        with self._lock:
            self._now = max(self._now, robot_time)

    def now(self) -> float:
        with self._lock:
            return self._now

    def utc(self, robot_time: float) -> datetime:
        return self._start + timedelta(seconds=robot_time)
