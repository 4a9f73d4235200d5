"""The UTC with which the service stamps its rows: the system's, unless it is doubtful.  Pure: time is an argument.

The system's clock may step at any moment, by decades: no battery, no network yet, a wrong command.  The monotonic
clock measures how much time has passed, the database has the time before, the kernel knows whether network time has
set the clock.  A step is followed when one of these confirms it; until then stamps go on as before.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta

__all__ = ["DOUBTFUL", "STEP_S", "ClockRow", "Mend", "Timekeeper"]

STEP_S = 60.0
"""smaller steps are followed at once [s]"""
BEHIND_S, AHEAD_S = 86400.0, 366 * 86400.0
"""a clock that is so far from the last known time [s] is wrong until network time confirms it: robots are switched
off for months, and no clock goes back by a day"""
CONFIRMED_S, ODD_CONFIRMED_S = 3600.0, 86400.0
"""a step is followed after so long without network time [s]; one to a time that is so far off after so long"""
DOUBTFUL = "clock"
"""in the quality of a window that was stamped while the clock was not to be believed"""
CATCH_UP = 2.0
"""the time up to which scores may be called old moves on by at most so many seconds a second"""


@dataclass(frozen=True, slots=True)
class ClockRow:
    """What a later run has to know: the time of the last stamps, and up to when scores may be called old.  Both are
    microseconds since 1970."""

    known_us: int
    bound_us: int


@dataclass(frozen=True, slots=True)
class Mend:
    """Rows stamped from since to until were stamped too early by ``shift``; the mark of a doubtful clock goes."""

    since: datetime
    until: datetime
    shift: timedelta


class Timekeeper:
    """UTC from robot time [s].

    now: robot time [s]; utc: the system's time then [s since 1970]; synced: returns whether network time has set it;
    known and bound: those of ``ClockRow`` [s], None where no earlier run has left them.  ``is_doubtful``: stamps go on
    from the last known time, since the system's is not trusted.
    """

    def __init__(
        self, now: float, utc: float, synced: Callable[[], bool], known: float | None = None, bound: float | None = None
    ) -> None:
        self._known = utc if known is None else known
        self._bound = min(utc, self._known if bound is None else bound)
        self._synced = synced()
        self.is_doubtful = not self._synced and self._is_odd(utc)
        self._offset = (self._known if self.is_doubtful else utc) - now
        self._begun = self.utc(now)
        self._looked = now
        self._step: tuple[float, float] | None = None

    def utc(self, robot_time: float) -> datetime:
        """The UTC of a robot time [s]."""
        return datetime.fromtimestamp(self._offset + robot_time, UTC)

    @property
    def row(self) -> ClockRow:
        """What a later run has to know."""
        return ClockRow(round(self._known * 1e6), round(self._bound * 1e6))

    @property
    def step(self) -> float:
        """By how much the system's clock is ahead of the stamps at present [s]; 0 where they follow it."""
        return self._step[0] - self._offset if self._step else 0.0

    def look(self, now: float, utc: float, synced: Callable[[], bool]) -> Mend | None:
        """Takes the system's time; what has to be mended, if a step is followed that proves earlier stamps wrong."""
        passed, self._looked = now - self._looked, now
        mend = self._follow(now, utc, synced)
        self._known = self._offset + now
        self._bound = min(self._bound + CATCH_UP * passed, self._known)
        return mend

    def _follow(self, now: float, utc: float, synced: Callable[[], bool]) -> Mend | None:
        offset = utc - now
        if abs(offset - self._offset) <= STEP_S and not self.is_doubtful:
            self._step = None
            self._offset = offset
            self._synced = self._synced or synced()
            return None
        if self._step is None or abs(offset - self._step[0]) > STEP_S:
            self._step = (offset, now)
        odd = self._is_odd(utc)
        lasted = now - self._step[1] >= (ODD_CONFIRMED_S if odd else CONFIRMED_S)
        is_synced = synced()
        if not (is_synced or lasted or (self.is_doubtful and not odd)):
            return None
        wrong = self.is_doubtful or (is_synced and not self._synced)
        shift = timedelta(seconds=offset - self._offset)
        mend = Mend(self._begun, self.utc(now), shift) if wrong else None
        self._offset, self._step, self._synced, self.is_doubtful = offset, None, is_synced, False
        self._begun = self.utc(now)
        return mend

    def _is_odd(self, utc: float) -> bool:
        return not -BEHIND_S <= utc - self._known <= AHEAD_S
