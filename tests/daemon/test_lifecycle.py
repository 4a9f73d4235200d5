"""The life of an alarm: every way of the table, and what it leaves in the alarm."""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, datetime, timedelta

import pytest

from lostmotion.daemon.lifecycle import NEXT, happen, is_possible, raised, reminder_due
from lostmotion.daemon.records import AlarmEvent, AlarmRow, AlarmState, Cause, Severity

NOON = datetime(2026, 1, 31, 12, tzinfo=UTC)
HOUR = timedelta(hours=1)
FRESH = raised("elbow", Cause.PLAY, Severity.WARNING, "much", NOON).alarm


def lived(*events: AlarmEvent) -> AlarmRow:
    """An alarm after these events, an hour apart."""
    alarm = FRESH
    for hours, event in enumerate(events, start=1):
        until = NOON + 24 * HOUR if event is AlarmEvent.SHELVED else None
        alarm = happen(alarm, event, NOON + hours * HOUR, until=until).alarm
    return alarm


@pytest.mark.parametrize(
    ("events", "state"),
    [
        ((), AlarmState.ACTIVE),
        ((AlarmEvent.ACKNOWLEDGED,), AlarmState.ACKNOWLEDGED),
        ((AlarmEvent.CLEARED,), AlarmState.RETURNED),
        ((AlarmEvent.CLEARED, AlarmEvent.ACKNOWLEDGED), AlarmState.NORMAL),
        ((AlarmEvent.ACKNOWLEDGED, AlarmEvent.CLEARED), AlarmState.NORMAL),
        ((AlarmEvent.CLEARED, AlarmEvent.RAISED), AlarmState.ACTIVE),
        ((AlarmEvent.ACKNOWLEDGED, AlarmEvent.ESCALATED), AlarmState.ACTIVE),
        ((AlarmEvent.ACKNOWLEDGED, AlarmEvent.EASED), AlarmState.ACKNOWLEDGED),
        ((AlarmEvent.SHELVED,), AlarmState.SHELVED),
        ((AlarmEvent.SHELVED, AlarmEvent.CLEARED, AlarmEvent.RAISED), AlarmState.SHELVED),
        ((AlarmEvent.SHELVED, AlarmEvent.UNSHELVED), AlarmState.ACTIVE),
        ((AlarmEvent.SHELVED, AlarmEvent.CLEARED, AlarmEvent.LAPSED), AlarmState.NORMAL),
    ],
)
def test_the_states_of_isa_18_2(events: tuple[AlarmEvent, ...], state: AlarmState) -> None:
    """Each walk through the table ends in the state that the standard names."""
    assert lived(*events).state is state


def test_what_the_table_does_not_know_cannot_happen() -> None:
    """A normal alarm is only raised; what is acknowledged is neither acknowledged again nor reminded of."""
    assert set(NEXT) == set(AlarmState)
    assert list(NEXT[AlarmState.NORMAL]) == [AlarmEvent.RAISED]
    known = lived(AlarmEvent.ACKNOWLEDGED)
    assert not is_possible(known, AlarmEvent.ACKNOWLEDGED)
    with pytest.raises(KeyError):
        happen(known, AlarmEvent.REMINDED, NOON)


def test_times_are_kept() -> None:
    """Acknowledged, cleared and shelved moments stand in the alarm; what comes back has lost them."""
    gone = lived(AlarmEvent.ACKNOWLEDGED, AlarmEvent.CLEARED)
    assert (gone.raised, gone.acknowledged, gone.cleared) == (NOON, NOON + HOUR, NOON + 2 * HOUR)
    shelved = lived(AlarmEvent.ACKNOWLEDGED, AlarmEvent.SHELVED)
    assert shelved.shelved_until == NOON + 24 * HOUR
    back = happen(shelved, AlarmEvent.UNSHELVED, NOON + 3 * HOUR, by="ann")
    assert (back.alarm.acknowledged, back.alarm.shelved_until, back.by) == (None, None, "ann")
    again = lived(AlarmEvent.CLEARED, AlarmEvent.RAISED)
    assert (again.raised, again.cleared, again.notified) == (NOON, None, NOON + 2 * HOUR)


def test_a_transition_has_one_name() -> None:
    """Its id tells joint, cause, time and event, so it is the same after a restart and differs from all others."""
    alarm = lived()
    one, two = (happen(alarm, event, NOON) for event in (AlarmEvent.ACKNOWLEDGED, AlarmEvent.SHELVED))
    assert one.id == "elbow/play/1769860800000000/acknowledged"
    assert one.id == happen(alarm, AlarmEvent.ACKNOWLEDGED, NOON).id != two.id


def test_reminders_grow_rarer() -> None:
    """Daily is a day after the last word, rarer after 1, 2, 4 hours, once never; news begin the count anew."""
    alarm, waits = FRESH, []
    for _ in range(4):
        due = reminder_due(alarm, "rarer")
        assert due is not None
        waits.append(due - alarm.notified)
        alarm = happen(alarm, AlarmEvent.REMINDED, due).alarm
    assert waits == [HOUR, 2 * HOUR, 4 * HOUR, 8 * HOUR]
    assert reminder_due(alarm, "daily") == alarm.notified + timedelta(days=1)
    assert reminder_due(alarm, "once") is None
    assert happen(alarm, AlarmEvent.ESCALATED, NOON, severity=Severity.ERROR).alarm.reminders == 0
    assert reminder_due(replace(alarm, reminders=10_000), "rarer") is not None


@pytest.mark.parametrize("events", [(AlarmEvent.ACKNOWLEDGED,), (AlarmEvent.CLEARED,), (AlarmEvent.SHELVED,)])
def test_only_what_nobody_knows_of_is_reminded_of(events: tuple[AlarmEvent, ...]) -> None:
    """Acknowledged, returned and shelved alarms keep quiet."""
    assert reminder_due(lived(*events), "daily") is None
