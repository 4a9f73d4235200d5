"""Health and alarms of a joint, from scores, play, trend and devices."""

from __future__ import annotations

import math
from datetime import UTC, datetime, timedelta
from typing import Any

import msgspec
import pytest

from lostmotion.daemon.alarm import Change, JointMonitor
from lostmotion.daemon.options import AlarmOptions
from lostmotion.daemon.records import (
    AlarmEvent,
    AlarmState,
    Cause,
    Health,
    JointRow,
    Origin,
    Request,
    ScoreRow,
    Severity,
    Transition,
    Verb,
)

NOON = datetime(2026, 1, 31, 12, tzinfo=UTC)
OPTIONS = AlarmOptions(windows=10, degraded=0.2, warning=0.5, error=5.0, off_delay_s=0.0)
RAISED, CLEARED = AlarmEvent.RAISED, AlarmEvent.CLEARED


def at(second: float) -> datetime:
    """So many seconds after noon."""
    return NOON + timedelta(seconds=second)


def monitor(**options: Any) -> JointMonitor:
    """A joint of which nothing is known."""
    return JointMonitor(JointRow("elbow", since=NOON), msgspec.structs.replace(OPTIONS, **options))


def score(ratio: float, second: float = 0, quality: str = "ok", play: float = math.nan, **more: float) -> ScoreRow:
    """A score of ``ratio`` times its level."""
    return ScoreRow("elbow", at(second), 0.25, 8.0 * ratio, 8.0, ratio > 1, play, quality=quality, **more)


def feed(joint: JointMonitor, *ratios: float, start: float = 0) -> list[Change]:
    """All changes that these scores, a second apart, bring."""
    return [change for second, ratio in enumerate(ratios) for change in joint.scored(score(ratio, start + second))]


def events(changes: list[Change]) -> list[tuple[AlarmEvent, Severity]]:
    """What happened to alarms, and how bad they were then."""
    return [(change.event, change.alarm.severity) for change in changes if isinstance(change, Transition)]


@pytest.mark.parametrize(
    ("above", "ratio", "health"),
    [
        (1, 2.0, Health.OK),
        (2, 2.0, Health.DEGRADED),
        (4, 2.0, Health.DEGRADED),
        (5, 2.0, Health.WARNING),
        (10, 4.9, Health.WARNING),
        (10, 5.1, Health.ERROR),
        (4, 99.0, Health.DEGRADED),
    ],
)
def test_the_last_windows_decide(above: int, ratio: float, health: Health) -> None:
    """Of ten windows: two above the level degrade, five warn, a median of five levels is an error."""
    joint = monitor()
    feed(joint, *[0.5] * (10 - above), *[ratio] * above)
    assert joint.row.health is health


def test_a_few_windows_say_nothing() -> None:
    """Four loud windows after a start change nothing yet, the fifth does; three do where three are all that count.
    Until then the joint is not OK, and there is no alarm."""
    joint = monitor()
    assert feed(joint, 9, 9, 9, 9) == []
    assert joint.row == JointRow("elbow", Health.DEGRADED, "not judged yet: too few sound windows", NOON)
    assert feed(joint, 9) != []
    few = monitor(windows=3)
    assert feed(few, 9, 9) == []
    assert feed(few, 9) != []


@pytest.mark.parametrize(("size", "health"), [(0.9e-3, Health.OK), (1.1e-3, Health.WARNING), (5.1e-3, Health.ERROR)])
def test_the_size_of_the_play_counts_where_it_has_limits(size: float, health: Health) -> None:
    """Quiet windows that measure a play beyond play_warning or play_error; without limits or a size nothing happens."""
    limited, free = monitor(play_warning=1e-3, play_error=5e-3), monitor()
    for joint in (limited, free):
        for second in range(10):
            joint.scored(score(0.5, second, play=size))
    assert (limited.row.health, free.row.health) == (health, Health.OK)


@pytest.mark.parametrize(
    ("arc_minutes", "low", "health"),
    [
        (19.0, 8.0, Health.OK),
        (21.0, 8.0, Health.WARNING),
        (36.0, 8.0, Health.WARNING),
        (61.0, 8.0, Health.ERROR),
        (61.0, 0.0, Health.OK),
    ],
)
def test_a_worn_joint_is_never_well(arc_minutes: float, low: float, health: Health) -> None:
    """Quiet scores do not hide a large equivalent play: beyond 20' it warns, beyond 1° it is an error, and 0.6° is
    never OK; where most windows may have no play at all it leads nowhere."""
    joint = monitor()
    for second in range(10):
        angle = math.radians(arc_minutes / 60)
        joint.scored(score(0.5, second, severity=angle, severity_low=math.radians(low / 60), severity_high=2 * angle))
    assert joint.row.health is health
    if health is not Health.OK:
        reason = f"play: 0% of the last 5 windows above the level, median 0.5 x level, severity {arc_minutes:.1f}'"
        assert joint.row.reason == reason


def test_severity_needs_windows_that_know_it() -> None:
    """Four of ten windows with a severity say nothing, five do, and those without one do not count."""
    joint, large = monitor(), {"severity": 0.03, "severity_low": 0.01, "severity_high": 0.05}
    for second in range(6):
        joint.scored(score(0.5, second))
    for second in range(4):
        joint.scored(score(0.5, 6 + second, **large))
    assert joint.row.health is Health.OK
    joint.scored(score(0.5, 10, **large))
    assert joint.row.health is Health.ERROR


def test_the_multiple_of_the_level_counts_where_it_is_given() -> None:
    """Without ``error`` in the configuration a median of nine levels is a warning, with 5 an error."""
    usual, old = monitor(error=None), monitor(error=5.0)
    for joint in (usual, old):
        feed(joint, *[9.0] * 10)
    assert (usual.row.health, old.row.health) == (Health.WARNING, Health.ERROR)


def test_a_trend_that_nears_the_level_degrades() -> None:
    """20 days left of 30 degrade a quiet joint, its deadband holds until 50 days, and NaN is no trend."""
    joint = monitor(trend_days=30.0)
    feed(joint, *[0.5] * 10)
    assert events(joint.trend(20.0, at(20))) == [(RAISED, Severity.DEGRADED)]
    assert joint.row.reason.endswith("at its limit in 20 days as its trend goes")
    assert joint.trend(45.0, at(21)) == []
    assert events(joint.trend(math.nan, at(22))) == [(CLEARED, Severity.DEGRADED)]
    off = monitor(trend_days=0.0)
    feed(off, *[0.5] * 10)
    assert off.trend(0.0, at(20)) == []


def test_health_does_not_flap() -> None:
    """A warning raised at half of the windows stays at 40 % and eases at 20 %: the deadband is 40 % of the limit."""
    joint = monitor()
    feed(joint, *[0.5, 2.0] * 5)
    assert joint.row.health is Health.WARNING
    assert feed(joint, *[0.5] * 4, start=10) == []
    changes = feed(joint, 0.5, 0.5, start=14)
    assert joint.row.health is Health.DEGRADED
    assert events(changes) == [(AlarmEvent.EASED, Severity.DEGRADED)]


def test_a_growing_play_is_one_alarm_that_escalates() -> None:
    """Warning first, at the window's time; as it becomes an error the same alarm escalates and is news again."""
    joint = monitor()
    changes = feed(joint, *[2.0] * 10)
    joint.request(Request(1, "elbow", Verb.ACK), at(10))
    changes += feed(joint, *[9.0] * 10, start=11)
    found = [change for change in changes if isinstance(change, Transition)]
    assert events(changes) == [(RAISED, Severity.WARNING), (AlarmEvent.ESCALATED, Severity.ERROR)]
    assert [change.time for change in found] == [at(4), at(15)]
    assert [change.alarm.raised for change in found] == [at(4)] * 2
    assert found[1].alarm.state is AlarmState.ACTIVE
    assert found[0].alarm.reason == "play: 100% of the last 5 windows above the level, median 2 x level"


def test_doubtful_windows_do_not_count() -> None:
    """A clipped or gappy window is stored, but no evidence."""
    joint = monitor()
    assert [change for k in range(20) for change in joint.scored(score(9.0, k, "clipped"))] == []
    assert joint.row.reason == "not judged yet: too few sound windows"


def test_evidence_grows_old() -> None:
    """A joint that was OK is DEGRADED, without an alarm, an hour after its last sound window where that is the limit;
    the next sound window makes it OK again, and with no limit it stays OK."""
    joint, patient = monitor(judged_within_h=1.0), monitor(judged_within_h=0.0)
    for one in (joint, patient):
        feed(one, *[0.5] * 5)
        assert one.row.health is Health.OK
        assert one.tick(at(4 + 3600)) == one.scored(score(9.0, 3610, "flat")) == []
    assert joint.tick(at(4 + 3601)) == [joint.row]
    reason = "not judged for more than 1 h: no sound window since 2026-01-31T12:00Z"
    assert joint.row == JointRow("elbow", Health.DEGRADED, reason, at(3605))
    assert joint.scored(score(0.5, 4000)) == [JointRow("elbow", Health.OK, "", at(4000))]
    assert patient.tick(at(1e7)) == []


@pytest.mark.parametrize(("count", "health"), [(4, Health.DEGRADED), (5, Health.OK)])
def test_a_restart_needs_evidence(count: int, health: Health) -> None:
    """What an earlier run called OK is so only with five sound windows among the last ones."""
    rows = [score(0.5, second, "flat") for second in range(5)] + [score(0.5, 5 + second) for second in range(count)]
    assert JointMonitor(JointRow("elbow", Health.OK, "", at(3)), OPTIONS, rows).row.health is health


def test_delays_keep_chatter_away() -> None:
    """With 5 s on and 10 s off: 4 s of a cause are no alarm, 5 s are; 9 s without it do not end it, 10 s do."""
    joint = monitor(on_delay_s=5.0, off_delay_s=10.0)
    assert joint.device("gone", at(0)) == joint.tick(at(4)) == []
    assert joint.device("", at(4.5)) == []
    assert joint.device("gone", at(10)) == joint.tick(at(14.9)) == []
    assert events(joint.tick(at(15))) == [(RAISED, Severity.ERROR)]
    assert joint.device("", at(20)) == joint.tick(at(29)) == []
    assert joint.device("gone", at(29)) == joint.device("", at(30)) == joint.tick(at(39)) == []
    assert events(joint.tick(at(40))) == [(CLEARED, Severity.ERROR)]


def test_a_cause_that_grows_during_its_delay_is_raised_once() -> None:
    """Worse and worse while the on-delay runs: one alarm, of the severity that there is at its end."""
    joint = monitor(on_delay_s=8.0, windows=5)
    changes = feed(joint, *[2.0] * 8, *[9.0] * 10)
    assert events(changes) == [(RAISED, Severity.ERROR)]


def test_a_dead_device_is_an_alarm_of_its_own() -> None:
    """A stale sensor is no ERROR of the joint: its alarm comes and goes beside the play's, the health is DEGRADED
    unless the play was worse."""
    calm = monitor()
    assert events(calm.device("tip: port is gone", NOON)) == [(RAISED, Severity.ERROR)]
    assert calm.row == JointRow("elbow", Health.DEGRADED, "tip: port is gone", NOON)
    assert calm.device("tip: port is gone", NOON) == []
    joint = monitor()
    feed(joint, *[2.0] * 10)
    joint.device("tip: port is gone", at(10))
    assert joint.row.health is Health.WARNING
    assert joint.row.reason.startswith("tip: port is gone; play: 100%")
    cleared = joint.device("", at(19))
    assert [change.alarm.cause for change in cleared if isinstance(change, Transition)] == [Cause.DEVICE]
    assert joint.row.health is Health.WARNING


def test_a_device_alarm_tells_the_present_fault() -> None:
    """Another fault of the same device changes the reason of the alarm that is active, and of the health."""
    joint = monitor()
    joint.device("port does not exist", NOON)
    change, health = joint.device("another servo answers", at(1))
    assert isinstance(change, Transition)
    assert (change.event, change.alarm.state, change.alarm.raised) == (AlarmEvent.CHANGED, AlarmState.ACTIVE, NOON)
    assert change.alarm.reason == "another servo answers"
    assert isinstance(health, JointRow)
    assert health.reason == "another servo answers"
    assert joint.device("another servo answers", at(2)) == []


def test_a_loose_plug_is_one_alarm() -> None:
    """Gone, missing and well in turn for ten minutes: raised, no more; a fault that stays since 598 is told."""
    joint = monitor(off_delay_s=10.0)
    course = [joint.device(("gone", "missing", "")[second % 3], at(second)) for second in range(600)]
    assert events([change for changes in course for change in changes]) == [(RAISED, Severity.ERROR)]
    assert joint.device("missing", at(600)) == joint.device("missing", at(607)) == []
    assert events(joint.device("missing", at(608))) == [(AlarmEvent.CHANGED, Severity.ERROR)]


def test_people_acknowledge() -> None:
    """The joint's alarms are acknowledged with the name of who did it, once; a cause chooses one of them."""
    joint = monitor()
    feed(joint, *[2.0] * 10)
    joint.device("gone", at(10))
    changes, answer = joint.request(Request(7, "elbow", Verb.ACK, Cause.DEVICE, by="ann"), at(11))
    assert [(change.by, change.alarm.cause) for change in changes if isinstance(change, Transition)] == [
        ("ann", Cause.DEVICE)
    ]
    assert (answer.id, answer.done, answer.text) == (7, True, "elbow: device acknowledged")
    changes, answer = joint.request(Request(8, "elbow", Verb.ACK), at(12))
    assert answer.text == "elbow: play acknowledged"
    changes, answer = joint.request(Request(9, "elbow", Verb.ACK), at(13))
    assert (changes, answer.done, answer.text) == ([], False, "elbow: nothing to be acknowledged")


def test_shelved_until_a_time() -> None:
    """A shelved alarm follows its cause in silence and comes back active when its time is over; unshelving ends it."""
    joint = monitor()
    joint.device("gone", NOON)
    changes, answer = joint.request(Request(1, "elbow", Verb.SHELVE, for_s=60.0), at(1))
    assert isinstance(changes[0], Transition)
    assert changes[0].alarm.shelved_until == at(61)
    assert answer.text == "elbow: device shelved until 2026-01-31 12:01 UTC"
    assert joint.tick(at(60)) == []
    assert events(joint.tick(at(61))) == [(AlarmEvent.UNSHELVED, Severity.ERROR)]
    joint.request(Request(2, "elbow", Verb.SHELVE, for_s=60.0), at(70))
    joint.device("", at(80))
    assert events(joint.request(Request(3, "elbow", Verb.UNSHELVE), at(90))[0]) == [(AlarmEvent.LAPSED, Severity.ERROR)]
    assert joint.request(Request(4, "elbow", Verb.ACK), at(91))[1].done is False


def test_reminders() -> None:
    """An alarm that nobody acknowledges is told again a day later, with the present reason; others are not."""
    joint = monitor(remind="daily")
    feed(joint, *[2.0] * 10)
    assert joint.tick(at(86400)) == []
    feed(joint, *[3.0] * 10, start=20)
    reminded = joint.tick(at(86404))
    assert events(reminded) == [(AlarmEvent.REMINDED, Severity.WARNING)]
    assert joint.row.reason.endswith("median 3 x level")
    joint.request(Request(1, "elbow", Verb.ACK), at(90000))
    assert joint.tick(at(300_000)) == []


@pytest.mark.parametrize("done", [None, Verb.ACK, Verb.SHELVE])
def test_a_restart_changes_nothing(done: Verb | None) -> None:
    """A monitor made from the stored rows goes on where the other was: no alarm is raised again, none forgotten."""
    joint = monitor()
    rows = [score(2.0, second) for second in range(10)]
    changes = [change for row in rows for change in joint.scored(row)]
    if done:
        changes += joint.request(Request(1, "elbow", done, for_s=1e6), at(10))[0]
    alarm = [change.alarm for change in changes if isinstance(change, Transition)][-1]
    again = JointMonitor(joint.row, OPTIONS, rows, [alarm])
    assert again.scored(score(2.0, 11)) == again.device("", at(11)) == again.tick(at(11)) == []
    quiet = feed(again, *[0.5] * 10, start=12)
    assert events(quiet)[-1][0] is CLEARED
    assert again.row.health is Health.OK


def test_play_of_another_joint_is_no_alarm() -> None:
    """Windows above the level raise nothing while the play is another joint's for sure; an alarm goes when it turns out
    to be."""
    others = Origin({"elbow": 0.4, "wrist": 0.99}, 30)
    joint = monitor()
    assert not events([change for k in range(10) for change in joint.scored(score(3, k), others)])
    assert joint.row.health is Health.OK
    unclear = Origin({"elbow": 0.6, "wrist": 0.5}, 30)
    assert (RAISED, Severity.WARNING) in events(joint.scored(score(3, 10), unclear))
    assert joint.row.reason.endswith("of elbow or wrist: not identified yet")
    assert events(joint.scored(score(3, 11), others)) == [(CLEARED, Severity.WARNING)]


def test_suspicion_waits_for_all_windows() -> None:
    """While nobody is named ten windows are waited for; the joint that is named is alarmed after five, as ever."""
    unclear, named = Origin({"elbow": 0.6, "wrist": 0.5}, 3), Origin({"elbow": 0.99, "wrist": 0.5}, 3)
    for origin, needed in ((unclear, 10), (named, 5), (None, 5)):
        joint = monitor()
        raised = [bool(events(joint.scored(score(3, k), origin))) for k in range(10)]
        assert raised.index(True) == needed - 1
