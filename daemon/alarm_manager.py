"""The alarms of a running service: the monitors of all joints, their requests and trends.

The service passes changes to the sinks; ``alarm.py`` decides when an alarm is raised.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from datetime import datetime, timedelta

from lostmotion.daemon import prognosis, requests
from lostmotion.daemon.alarm import Change
from lostmotion.daemon.options import AlarmOptions
from lostmotion.daemon.records import AlarmState, Answer, Cause, Health, JointRow, Origin, ScoreRow, Transition
from lostmotion.daemon.store import Store

__all__ = ["AlarmManager", "is_over"]

SETTLE_S = 0.02
"""how long the main thread waits for the disk to take an alarm before it goes on and publishes it later [s]"""
AGAIN = 8
"""transitions of each alarm that are published again at a start: one may have been stored but not published"""
TREND = timedelta(hours=1)
"""how often a joint's trend is computed"""


class AlarmManager:
    """Health and alarms of the joints, from where an earlier run left them.

    publish: gets a change, and whether an earlier run may have published it already.  ``publish_settled`` publishes an
    alarm once it is stored, so that a kill cannot publish it twice with two ids.  ``is_provisional``: the store could
    not be opened, so earlier runs may be unknown.  known: ``newest`` of the manager before a reload on the same
    store.
    """

    def __init__(
        self,
        joints: Iterable[str],
        options: AlarmOptions,
        store: Store,
        publish: Callable[[Change, bool], None],
        utc: datetime,
        known: Sequence[Change | ScoreRow] = (),
    ) -> None:
        self.is_provisional = not store.is_open
        self._store = store
        self._publish = publish
        self._options = options
        self._reader = store.reader()
        self._monitors = {joint: requests.resume(self._reader, joint, options, utc, known) for joint in joints}
        self._trend_due = dict.fromkeys(self._monitors, utc)
        self._last_request = 0
        self._last: dict[tuple[str, Cause], Transition] = {}
        unwritten = {(one.alarm.joint, one.alarm.cause): one for one in known if isinstance(one, Transition)}
        for joint, monitor in self._monitors.items():
            for cause in Cause:
                stored = [transition for _, transition in self._reader.transitions(joint, cause, newest=AGAIN)]
                last = unwritten.get((joint, cause))
                if last is not None and (not stored or last.time > stored[-1].time):
                    stored.append(last)
                for transition in stored:
                    self._last[joint, cause] = transition
                    self._publish(transition, True)
            self._change([monitor.row])
        for gone in {row.name for row in self._reader.joints()} - set(self._monitors):
            self._change(requests.resume(self._reader, gone, options, utc, known).retire(utc))

    @property
    def healths(self) -> list[Health]:
        """The present health of each joint."""
        return [monitor.row.health for monitor in self._monitors.values()]

    @property
    def newest(self) -> list[Change | ScoreRow]:
        """What is known of these joints, written yet or not: their health, its windows, and the last word on each
        alarm."""
        monitors = self._monitors.values()
        windows = (row for one in monitors for row in one.windows)
        return [*windows, *(one.row for one in monitors), *self._last.values()]

    def scored(self, row: ScoreRow, origin: Origin | None = None, comparisons: int | None = None) -> None:
        """A window has been scored; origin: whose play it may be; comparisons: how often the sensor was compared with
        the motion so far, None when it is known to measure it."""
        self._change(self._monitors[row.joint].scored(row, origin, comparisons))

    def look(
        self, joint: str, fault: str | None, utc: datetime, doubt: str = "", comparisons: int | None = None
    ) -> None:
        """Time has passed; fault: what is wrong with the joint's devices, "" for nothing, None while it is unknown;
        doubt: why the joint must not be called healthy yet."""
        self._change(self._monitors[joint].compared(doubt, comparisons, utc))
        if fault is not None:
            self._change(self._monitors[joint].device(fault, utc))
        self._change(self._monitors[joint].tick(utc))

    def take_requests(self, utc: datetime) -> None:
        """What people have asked of the alarms since the last look."""
        asked = self._reader.requests(self._last_request)
        for request in asked:
            self._last_request = request.id
        self._change(requests.take(asked, self._monitors, self._reader, utc))

    def ask_trend(self, utc: datetime) -> None:
        """The trend of one joint whose turn it is: the caller is never away for long."""
        joint = next((joint for joint, due in self._trend_due.items() if due <= utc), None)
        if joint is not None:
            self._trend_due[joint] = utc + TREND
            options = self._options
            days = prognosis.days_to_limit(self._reader, joint, utc, options.severity_warning, options.trend_days)
            self._change(self._monitors[joint].trend(days, utc))

    def publish_settled(self, wait_s: float = SETTLE_S) -> None:
        """Publishes the alarms that are on the disk, or are within ``wait_s``: one wait for all of them."""
        for transition in self._store.settled(wait_s):
            self._publish(transition, False)

    def close(self) -> None:
        """Reads no more."""
        self._reader.close()

    def _change(self, rows: Sequence[Change | Answer]) -> None:
        if rows:
            self._store.add(*rows)
        for row in rows:
            if isinstance(row, Transition):
                self._last[row.alarm.joint, row.alarm.cause] = row
            elif isinstance(row, JointRow):
                self._publish(row, False)


def is_over(row: Change | ScoreRow) -> bool:
    """Whether it is the last word on an alarm that is over, which another database need not begin with."""
    return isinstance(row, Transition) and row.alarm.state is AlarmState.NORMAL
