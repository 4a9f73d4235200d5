"""A joint's health and alarms, from the last windows and the state of the devices.  No I/O; time is an argument.

Two causes are followed independently: play, and a failed device.  Each has at most one alarm, with the states of
``lifecycle.py``; ``evidence.py`` grades the severity of play.  A failed device raises its own alarm and is no evidence
about play: the joint's health is then DEGRADED, because it is not monitored, or stays what it was.
Health is OK only with enough sound windows, the last one recent; without them it is DEGRADED, and no alarm is raised.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable
from datetime import datetime, timedelta

from lostmotion.daemon.evidence import LEAST_WINDOWS, RANK, Evidence, grade
from lostmotion.daemon.lifecycle import happen, is_possible, raised, reminder_due
from lostmotion.daemon.options import AlarmOptions
from lostmotion.daemon.records import (
    AlarmEvent,
    AlarmRow,
    AlarmState,
    Answer,
    Cause,
    Health,
    JointRow,
    Origin,
    Request,
    ScoreRow,
    Severity,
    Task,
    Transition,
    Verb,
    iso,
)

__all__ = ["Change", "JointMonitor"]

Change = Transition | JointRow
HEALTH = dict(zip(RANK, Health, strict=True))
DONE: dict[Verb | Task, str] = {Verb.ACK: "acknowledged", Verb.SHELVE: "shelved", Verb.UNSHELVE: "unshelved"}


class JointMonitor:
    """Follows one joint.  ``row`` is its health; every method returns what changed, to be stored and published.

    row, recent (scores, oldest first), alarms (those that are not normal) and origin carry on where an earlier run
    stopped.
    """

    def __init__(
        self, row: JointRow, options: AlarmOptions, recent: Iterable[ScoreRow] = (), alarms: Iterable[AlarmRow] = (),
        origin: Origin | None = None,
    ) -> None:  # fmt: skip
        self.row = row
        self._options = options
        self._windows = deque((score for score in recent if score.quality == "ok"), maxlen=options.windows)
        self._doubt = ""
        self._held: deque[tuple[int, ScoreRow, Origin | None]] = deque(maxlen=options.windows)
        self._days = math.nan
        self._origin = origin
        self._alarms = {alarm.cause: alarm for alarm in alarms}
        self._wanted = {cause: self._standing(cause) for cause in Cause}
        self._reasons: dict[Cause, Evidence | str] = {  # formatted when they are published
            cause: self._alarms[cause].reason if cause in self._alarms else "" for cause in Cause
        }
        self._leaning: dict[Cause, tuple[bool, datetime]] = {}
        self._other: dict[Cause, tuple[object, datetime]] = {}
        self._update_health(row.since)

    @property
    def windows(self) -> tuple[ScoreRow, ...]:
        """The sound windows that count at present, oldest first."""
        return tuple(self._windows)

    def scored(
        self, score: ScoreRow, origin: Origin | None = None, comparisons: int | None = None
    ) -> list[Change]:  # fmt: skip
        """Takes one scored window; what its quality, or the sensor, puts in doubt does not count.  Where joints share
        accelerometers, play that is another one's is no alarm of this one.

        comparisons: of the sensor with the motion so far, None when it is known to measure it.  Until then a window
        counts only after the next comparison, which may find that it is no evidence.
        """
        if score.quality != "ok" or self._doubt:
            return []
        if comparisons is not None:
            self._held.append((comparisons, score, origin))
            return []
        self._windows.append(score)
        self._origin = origin
        self._judge()
        return self._update(score.time)

    def compared(self, doubt: str, comparisons: int | None, time: datetime) -> list[Change]:
        """Takes what comparisons of the sensor with the motion have found.  doubt: why sound windows are no evidence at
        present, "" for no reason; comparisons: as for ``scored``."""
        self._doubt = doubt
        if doubt:
            self._held.clear()
        if not self._held or self._held[0][0] == comparisons:
            return []
        while self._held and self._held[0][0] != comparisons:
            _, score, self._origin = self._held.popleft()
            self._windows.append(score)
        self._judge()
        return self._update(time)

    def trend(self, days: float, time: datetime) -> list[Change]:
        """Takes in how many days the score will reach its level; NaN for never or unknown."""
        self._days = days
        self._judge()
        return self._update(time)

    def device(self, fault: str, time: datetime) -> list[Change]:
        """Takes the fault of the joint's servo or accelerometer; "" for none."""
        self._want(Cause.DEVICE, Severity.ERROR if fault else None, fault)
        return self._update(time)

    def tick(self, time: datetime) -> list[Change]:
        """What has changed by time alone: delays that are over, the end of shelving, reminders."""
        changes: list[Change] = []
        for cause, alarm in list(self._alarms.items()):
            due = reminder_due(alarm, self._options.remind)
            if alarm.shelved_until and time >= alarm.shelved_until:
                changes.append(self._unshelve(alarm, time))
            elif due and time >= due:
                changes.append(self._keep(happen(alarm, AlarmEvent.REMINDED, time, reason=str(self._reasons[cause]))))
        return changes + self._update(time)

    def request(self, request: Request, time: datetime) -> tuple[list[Change], Answer]:
        """Carries out a request; the changes, and the answer."""
        changes: list[Change] = []
        until = time + timedelta(seconds=request.for_s)
        for alarm in [alarm for cause, alarm in self._alarms.items() if request.cause in (None, cause)]:
            if request.verb is Verb.UNSHELVE and alarm.state is AlarmState.SHELVED:
                changes.append(self._unshelve(alarm, time, request.by))
            elif request.verb is Verb.ACK and is_possible(alarm, AlarmEvent.ACKNOWLEDGED):
                changes.append(self._keep(happen(alarm, AlarmEvent.ACKNOWLEDGED, time, by=request.by)))
            elif request.verb is Verb.SHELVE:
                changes.append(self._keep(happen(alarm, AlarmEvent.SHELVED, time, until=until, by=request.by)))
        causes = ", ".join(change.alarm.cause.value for change in changes if isinstance(change, Transition))
        lasting = f" until {until:%Y-%m-%d %H:%M} UTC" if request.verb is Verb.SHELVE and changes else ""
        text = f"{self.row.name}: {causes or 'nothing to be'} {DONE[request.verb]}{lasting}"
        return changes, Answer(request.id, bool(changes), text)

    def retire(self, time: datetime) -> list[Change]:
        """The joint is no longer monitored: its alarms are cleared, because nothing would clear them later."""
        standing = [alarm for alarm in self._alarms.values() if alarm.cleared is None]
        changes: list[Change] = [self._keep(happen(alarm, AlarmEvent.CLEARED, time)) for alarm in standing]
        if changes or self.row.health is not Health.OK:
            self.row = JointRow(self.row.name, Health.OK, "not watched any longer", time)
            changes.append(self.row)
        return changes

    @property
    def _is_enough(self) -> bool:
        """Whether there are windows enough for a judgement."""
        # Before joints are suspected that another one may drown out, all the windows that count are waited for.
        least = self._options.windows if self._origin and self._origin.is_open else LEAST_WINDOWS
        return len(self._windows) >= min(least, self._options.windows)

    def _judge(self) -> None:
        origin = self._origin
        if not self._is_enough:
            return
        evidence = Evidence.of(self._windows, self._days, origin)
        severity = grade(evidence, self._options, self._wanted[Cause.PLAY])
        self._want(Cause.PLAY, None if origin and origin.spares(self.row.name) else severity, evidence)

    def _want(self, cause: Cause, severity: Severity | None, reason: Evidence | str) -> None:
        self._wanted[cause], self._reasons[cause] = severity, reason

    def _standing(self, cause: Cause) -> Severity | None:
        """The severity of a cause as it was last published; None for no alarm."""
        alarm = self._alarms.get(cause)
        return alarm.severity if alarm and alarm.cleared is None else None

    def _update(self, time: datetime) -> list[Change]:
        changes: list[Change] = [self._keep(change) for cause in Cause if (change := self._follow(cause, time))]
        if self._update_health(time):
            changes.append(self.row)
        return changes

    def _update_health(self, time: datetime) -> bool:
        """Whether the health is another one, or for another reason, than before."""
        health = HEALTH[self._standing(Cause.PLAY)]
        reason = "; ".join(self._alarms[cause].reason for cause in reversed(Cause) if self._standing(cause))
        if health is Health.OK and (reason := reason or self._unjudged(time)):
            health = Health.DEGRADED
        if (health, reason) == (self.row.health, self.row.reason):
            return False
        self.row = JointRow(self.row.name, health, reason, time)
        return True

    def _unjudged(self, time: datetime) -> str:
        """Why the windows do not determine the health at present, "" when they do."""
        if self._doubt:
            return f"not judged yet: {self._doubt}"
        if not self._is_enough:
            return "not judged yet: too few sound windows"
        last, hours = self._windows[-1].time, self._options.judged_within_h
        if hours and time - last > timedelta(hours=hours):
            return f"not judged for more than {hours:g} h: no sound window since {iso(last)[:16]}Z"
        return ""

    def _follow(self, cause: Cause, time: datetime) -> Transition | None:
        """The alarm of a cause follows it, once the cause has been worse, or better, for long enough."""
        wanted, reason, standing = self._wanted[cause], self._reasons[cause], self._standing(cause)
        alarm = self._alarms.get(cause)
        if wanted is standing:
            self._leaning.pop(cause, None)
            # The figures of the play change with every window; another fault of a device is news, if it stays.
            if alarm is None or wanted is None or cause is Cause.PLAY or not self._has_become(reason, alarm, time):
                return None
            return happen(alarm, AlarmEvent.CHANGED, time, reason=str(reason))
        worse = RANK[wanted] > RANK[standing]
        was_worse, since = self._leaning.setdefault(cause, (worse, time))
        if was_worse is not worse:
            since = time
            self._leaning[cause] = (worse, time)
        if time - since < timedelta(seconds=self._options.on_delay_s if worse else self._options.off_delay_s):
            return None
        del self._leaning[cause]
        if wanted is None:
            assert alarm is not None
            return happen(alarm, AlarmEvent.CLEARED, time)
        if alarm is None:
            return raised(self.row.name, cause, wanted, str(reason), time)
        event = AlarmEvent.RAISED if standing is None else AlarmEvent.ESCALATED if worse else AlarmEvent.EASED
        return happen(alarm, event, time, severity=wanted, reason=str(reason))

    def _has_become(self, reason: object, alarm: AlarmRow, time: datetime) -> bool:
        """Whether an alarm's reason is another one, and has been for long enough."""
        if reason == alarm.reason:
            self._other.pop(alarm.cause, None)
            return False
        other, since = self._other.get(alarm.cause, (None, time))
        if other != reason:
            self._other[alarm.cause] = (reason, since := time)
        return time - since >= timedelta(seconds=self._options.off_delay_s)

    def _unshelve(self, alarm: AlarmRow, time: datetime, by: str = "") -> Transition:
        event = AlarmEvent.UNSHELVED if alarm.cleared is None else AlarmEvent.LAPSED
        return self._keep(happen(alarm, event, time, by=by))

    def _keep(self, change: Transition) -> Transition:
        """Remembers the alarm as it is now; a normal one is forgotten."""
        self._alarms[change.alarm.cause] = change.alarm
        if change.alarm.state is AlarmState.NORMAL:
            del self._alarms[change.alarm.cause]
        return change
