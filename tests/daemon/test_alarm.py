"""Health and alarms of a joint, from scores and from devices."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta

import pytest

from lostmotion.daemon.alarm import JointMonitor
from lostmotion.daemon.options import AlarmOptions
from lostmotion.daemon.records import AlarmRow, Cause, Health, JointRow, ScoreRow, Severity

NOON = datetime(2026, 1, 31, 12, tzinfo=UTC)
OPTIONS = AlarmOptions(windows=10, degraded=0.2, warning=0.5, error=5.0)


def monitor() -> JointMonitor:
    """A joint of which nothing is known."""
    return JointMonitor(JointRow("elbow", since=NOON), OPTIONS)


def score(ratio: float, second: int = 0, quality: str = "ok") -> ScoreRow:
    """A score of ``ratio`` times its level."""
    return ScoreRow("elbow", NOON + timedelta(seconds=second), 0.25, 8.0 * ratio, 8.0, ratio > 1, quality=quality)


def feed(joint: JointMonitor, *ratios: float) -> list[AlarmRow | JointRow]:
    """All changes that these scores, a second apart, bring."""
    return [change for second, ratio in enumerate(ratios) for change in joint.scored(score(ratio, second))]


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
    """Four loud windows after a start change nothing yet, the fifth does."""
    joint = monitor()
    assert feed(joint, 9, 9, 9, 9) == []
    assert feed(joint, 9) != []


def test_health_does_not_flap() -> None:
    """A warning raised at half of the windows stays at 30 % and goes at 20 %: one alarm, not many."""
    joint = monitor()
    feed(joint, *[0.5, 2.0] * 5)
    assert joint.row.health is Health.WARNING
    assert feed(joint, *[0.5] * 4) == []
    changes = feed(joint, 0.5, 0.5)
    assert joint.row.health is Health.DEGRADED
    assert [type(change) for change in changes] == [AlarmRow, JointRow]
    assert isinstance(changes[0], AlarmRow)
    assert changes[0].state == "cleared"


def test_a_growing_play_raises_one_alarm_after_the_other() -> None:
    """Warning first; as it becomes an error the warning is cleared and an error raised, at the window's time."""
    joint = monitor()
    changes = feed(joint, *[2.0] * 10, *[9.0] * 10)
    alarms = [change for change in changes if isinstance(change, AlarmRow)]
    assert [(alarm.severity, alarm.state) for alarm in alarms] == [
        (Severity.WARNING, "active"),
        (Severity.WARNING, "cleared"),
        (Severity.ERROR, "active"),
    ]
    assert alarms[0].raised == alarms[1].raised == NOON + timedelta(seconds=4)
    assert alarms[1].cleared == alarms[2].raised == NOON + timedelta(seconds=14)
    assert alarms[0].reason == "play: 100% of the last 5 windows above the level, median 2 x level"


def test_doubtful_windows_do_not_count() -> None:
    """A clipped or gappy window is stored, but no evidence."""
    joint = monitor()
    assert [change for k in range(20) for change in joint.scored(score(9.0, k, "clipped"))] == []
    assert joint.row.health is Health.OK


def test_a_dead_device_is_an_error_beside_the_play() -> None:
    """The device's alarm comes and goes without touching the play's; the health is the worse of both."""
    joint = monitor()
    feed(joint, *[2.0] * 10)
    raised = joint.device("tip: port is gone", NOON)
    assert joint.row == JointRow("elbow", Health.ERROR, "tip: port is gone", NOON)
    assert raised[0] == AlarmRow("elbow", Cause.DEVICE, Severity.ERROR, NOON, "tip: port is gone")
    assert joint.device("tip: port is gone", NOON) == []
    cleared = joint.device("", NOON + timedelta(seconds=9))
    assert [change.cause for change in cleared if isinstance(change, AlarmRow)] == [Cause.DEVICE]
    assert joint.row.health is Health.WARNING


def test_a_restart_changes_nothing() -> None:
    """A monitor made from the stored rows goes on where the other was: no alarm is raised again, none forgotten."""
    joint = monitor()
    rows = [score(2.0, second) for second in range(10)]
    active = [change for row in rows for change in joint.scored(row) if isinstance(change, AlarmRow)]
    again = JointMonitor(joint.row, OPTIONS, rows, active)
    assert again.scored(score(2.0, 11)) == []
    assert again.device("", NOON) == []
    quiet = feed(again, *[0.5] * 10)
    assert [change.state for change in quiet if isinstance(change, AlarmRow)] == ["cleared"]
    assert again.row.health is Health.OK


def test_a_device_alarm_tells_the_present_fault() -> None:
    """Another fault of the same device changes the reason of the alarm that is active, and of the health."""
    joint = monitor()
    joint.device("port does not exist", NOON)
    changes = joint.device("another servo answers", NOON)
    assert [change.reason for change in changes] == ["another servo answers"] * 2
    alarm = changes[0]
    assert isinstance(alarm, AlarmRow)
    assert (alarm.state, alarm.raised) == ("active", NOON)
    assert joint.device("another servo answers", NOON) == []
