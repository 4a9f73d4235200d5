"""The life cycle of an alarm after ISA-18.2: the table of its states and what each event does to it.

No I/O, no clock: the time is an argument.  ``alarm.py`` decides when an event happens.
"""

from __future__ import annotations

from dataclasses import replace
from datetime import datetime, timedelta

from lostmotion.daemon.records import AlarmEvent, AlarmRow, AlarmState, Cause, Severity, Transition

__all__ = ["NEXT", "happen", "is_possible", "raised", "reminder_due"]

NORMAL, ACTIVE, ACKNOWLEDGED = AlarmState.NORMAL, AlarmState.ACTIVE, AlarmState.ACKNOWLEDGED
RETURNED, SHELVED = AlarmState.RETURNED, AlarmState.SHELVED

NEXT: dict[AlarmState, dict[AlarmEvent, AlarmState]] = {
    NORMAL: {AlarmEvent.RAISED: ACTIVE},
    ACTIVE: {
        AlarmEvent.ESCALATED: ACTIVE,
        AlarmEvent.EASED: ACTIVE,
        AlarmEvent.CHANGED: ACTIVE,
        AlarmEvent.CLEARED: RETURNED,
        AlarmEvent.ACKNOWLEDGED: ACKNOWLEDGED,
        AlarmEvent.SHELVED: SHELVED,
        AlarmEvent.REMINDED: ACTIVE,
    },
    ACKNOWLEDGED: {
        AlarmEvent.ESCALATED: ACTIVE,  # worse than what was acknowledged
        AlarmEvent.EASED: ACKNOWLEDGED,
        AlarmEvent.CHANGED: ACKNOWLEDGED,
        AlarmEvent.CLEARED: NORMAL,
        AlarmEvent.SHELVED: SHELVED,
    },
    RETURNED: {
        AlarmEvent.RAISED: ACTIVE,
        AlarmEvent.ACKNOWLEDGED: NORMAL,
        AlarmEvent.SHELVED: SHELVED,
    },
    SHELVED: {
        AlarmEvent.RAISED: SHELVED,
        AlarmEvent.ESCALATED: SHELVED,
        AlarmEvent.EASED: SHELVED,
        AlarmEvent.CHANGED: SHELVED,
        AlarmEvent.CLEARED: SHELVED,
        AlarmEvent.SHELVED: SHELVED,  # until another time
        AlarmEvent.UNSHELVED: ACTIVE,
        AlarmEvent.LAPSED: NORMAL,
    },
}
FIRST_REMINDER = timedelta(hours=1)
"""growing rarer: after one hour, then two, four, eight ..."""
DAY = timedelta(days=1)
MOST_DOUBLINGS = 14
"""two years: more would not be a reminder, and overflow in the end"""


def is_possible(alarm: AlarmRow, event: AlarmEvent) -> bool:
    """Whether the table has a way for this event."""
    return event in NEXT[alarm.state]


def raised(joint: str, cause: Cause, severity: Severity, reason: str, time: datetime) -> Transition:
    """A new alarm, where there was none."""
    return Transition(AlarmEvent.RAISED, time, AlarmRow(joint, cause, severity, time, reason, notified=time))


def happen(
    alarm: AlarmRow,
    event: AlarmEvent,
    time: datetime,
    *,
    severity: Severity | None = None,
    reason: str | None = None,
    until: datetime | None = None,
    by: str = "",
) -> Transition:
    """What the event makes of an alarm.

    severity and reason: the new ones, of RAISED, ESCALATED, EASED, CHANGED; until: of SHELVED.  Raises KeyError for an
    event that the table does not know in the alarm's state.
    """
    state = NEXT[alarm.state][event]
    after = replace(
        alarm, state=state, severity=severity or alarm.severity, reason=alarm.reason if reason is None else reason
    )
    match event:
        case AlarmEvent.RAISED:
            after = replace(after, cleared=None)
        case AlarmEvent.CLEARED:
            after = replace(after, cleared=time)
        case AlarmEvent.ACKNOWLEDGED:
            after = replace(after, acknowledged=time)
        case AlarmEvent.SHELVED:
            after = replace(after, shelved_until=until)
        case AlarmEvent.UNSHELVED | AlarmEvent.LAPSED:
            after = replace(after, shelved_until=None)
        case AlarmEvent.REMINDED:
            after = replace(after, notified=time, reminders=alarm.reminders + 1)
    if state is ACTIVE and (alarm.state is not ACTIVE or event is AlarmEvent.ESCALATED):
        after = replace(after, acknowledged=None, notified=time, reminders=0)  # news: reminders begin anew
    return Transition(event, time, after, by)


def reminder_due(alarm: AlarmRow, remind: str) -> datetime | None:
    """When to remind of an alarm that nobody has acknowledged; None for never.  remind: "once", "daily", "rarer"."""
    if alarm.state is not ACTIVE or remind == "once":
        return None
    return alarm.notified + (DAY if remind == "daily" else FIRST_REMINDER * 2 ** min(alarm.reminders, MOST_DOUBLINGS))
