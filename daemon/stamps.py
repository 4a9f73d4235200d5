"""The UTC of robot times: the system's clock, watched, or the clock of a virtual robot, which needs no watching."""

from __future__ import annotations

import logging
import time
from datetime import datetime

from msgspec.structs import replace

from lostmotion.daemon.records import ScoreRow
from lostmotion.daemon.repeats import Condition
from lostmotion.daemon.store import Store
from lostmotion.daemon.timekeeper import DOUBTFUL, ClockRow, Timekeeper
from lostmotion.drivers import clock
from lostmotion.drivers.clock import Clock, SystemClock

__all__ = ["Stamps"]

log = logging.getLogger(__name__)

LATE_S = 60.0
"""by how much stamps may be ahead of what the database has of the time [s]"""


class Stamps:
    """UTC from robot time [s], by the clock of a robot and what the store has of earlier runs."""

    def __init__(self, robot_clock: Clock, store: Store) -> None:
        self._keeper: Timekeeper | None = None
        self._condition = Condition(reported="")
        self.follow(robot_clock, store)

    def follow(self, robot_clock: Clock, store: Store) -> None:
        """Takes the clock and the store of a new configuration; what is known of the system's clock stays."""
        self._clock, self._store = robot_clock, store
        self._keeper = (self._keeper or _timekeeper(store)) if isinstance(robot_clock, SystemClock) else None

    def utc(self, robot_time: float) -> datetime:
        """The UTC of a robot time [s]."""
        return (self._keeper or self._clock).utc(robot_time)

    @property
    def rows(self) -> list[ClockRow]:
        """What a later run has to know."""
        return [self._keeper.row] if self._keeper else []

    def marked(self, row: ScoreRow) -> ScoreRow:
        """The score, with a mark where its time is in doubt."""
        if self._keeper is None or not self._keeper.is_doubtful:
            return row
        return replace(row, quality=DOUBTFUL if row.quality == "ok" else f"{row.quality},{DOUBTFUL}")

    def look(self) -> None:
        """Follows the system's clock where it is trusted, and logs how a step is handled."""
        keeper = self._keeper
        if keeper is None:
            return
        now = time.monotonic()
        mend = keeper.look(now, clock.wall(), clock.is_synchronised)
        if mend is not None:
            self._store.add(mend)
            log.warning("the system's clock is right now: stamps since the start are moved by %s", mend.shift)
        problem = ""
        if keeper.is_doubtful:
            problem = "is far from the last known time: stamps go on from that one, and are marked 'clock'"
        elif keeper.step:
            problem = f"has stepped by {keeper.step:+.0f} s: stamps go on as before until it is confirmed"
        if self._condition.is_news("wrong" if problem else "", now):
            log.warning("the system's clock %s", problem or "is followed again")


def _timekeeper(store: Store) -> Timekeeper:
    """Goes on from what earlier runs knew of the time; a database of an older version knows only its newest stamp."""
    with store.reader() as reader:
        row, newest = reader.clock(), reader.newest()
    known, bound = None, newest.timestamp() if newest else None
    if row is not None:
        known, bound = row.known_us / 1e6, row.bound_us / 1e6
        if newest is not None and 0 < newest.timestamp() - known < LATE_S:  # a kill let the stamps get ahead
            known = newest.timestamp()
    keeper = Timekeeper(time.monotonic(), clock.wall(), clock.is_synchronised, known, bound)
    store.add(keeper.row)
    return keeper
