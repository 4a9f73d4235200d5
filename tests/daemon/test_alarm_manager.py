"""The alarm_manager: what is stored, what is told, and in which order; on a real database."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import closing
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from lostmotion.daemon.alarm import Change
from lostmotion.daemon.alarm_manager import AlarmManager
from lostmotion.daemon.options import AlarmOptions
from lostmotion.daemon.reader import open_readonly
from lostmotion.daemon.records import AlarmEvent, Health, JointRow, Request, ScoreRow, Severity, Transition, Verb
from lostmotion.daemon.requests import ask
from lostmotion.daemon.store import Store
from tests.daemon.conftest import wait_until
from tests.daemon.fakes import files_up_to

NOON = datetime(2026, 1, 31, 12, tzinfo=UTC)


@pytest.fixture
def store(tmp_path: Path) -> Iterator[Store]:
    """An empty database."""
    with closing(Store(tmp_path / "history.db", "arm1")) as store:
        yield store


class World:
    """A alarm_manager for the elbow, and what it has told."""

    def __init__(self, store: Store, utc: datetime = NOON, known: Sequence[Change | ScoreRow] = ()) -> None:
        self.store = store
        self.published: list[tuple[Change, bool]] = []
        self.alarm_manager = AlarmManager(["elbow"], AlarmOptions(off_delay_s=0.0), store, self._tell, utc, known)

    def _tell(self, change: Change, again: bool) -> None:
        if isinstance(change, Transition) and not self.store.problem:
            with self.store.reader() as reader:
                assert change in [stored for _, stored in reader.transitions()]
        self.published.append((change, again))

    def events(self, again: bool = False) -> list[AlarmEvent]:
        """What has happened to alarms, for the first time or again."""
        self.alarm_manager.publish_settled(5.0)
        return [change.event for change, before in self.published if isinstance(change, Transition) and before is again]


def fill(store: Store) -> None:
    """So many scores that a file of limited size cannot grow any more."""
    store.add(*(ScoreRow("other", NOON + timedelta(seconds=k), 0.25, 1.0, 8.0, False) for k in range(12_000)))
    wait_until(lambda: store.problem)


def test_an_alarm_is_in_the_database_when_it_is_told(store: Store) -> None:
    """Each transition is found by a reader at the moment at which it is told, each once, in order."""
    world = World(store)
    for second, fault in enumerate(["gone", "", "gone", "another one", ""]):
        world.alarm_manager.look("elbow", fault, NOON + timedelta(seconds=second))
    assert world.events() == [
        AlarmEvent.RAISED, AlarmEvent.CLEARED, AlarmEvent.RAISED, AlarmEvent.CHANGED, AlarmEvent.CLEARED,
    ]  # fmt: skip
    assert world.alarm_manager.healths == [Health.DEGRADED]  # no window has been judged


def test_another_run_tells_the_newest_transitions_again(store: Store) -> None:
    """As told before, marked as such, then the joint's health; nothing new happens."""
    first = World(store)
    first.alarm_manager.look("elbow", "gone", NOON)
    assert first.events() == [AlarmEvent.RAISED]
    before = [change for change, _ in first.published if isinstance(change, Transition)]
    first.alarm_manager.close()
    wait_until(lambda: not store.waiting())
    second = World(store)
    second.alarm_manager.look("elbow", "gone", NOON + timedelta(seconds=9))
    assert [change for change, again in second.published if again] == before
    assert second.events() == []
    assert isinstance(second.published[-1][0], JointRow)
    assert second.alarm_manager.healths == [Health.DEGRADED]


@pytest.mark.parametrize("is_over", [False, True])
def test_a_reload_knows_what_a_full_disk_has_not_taken(store: Store, is_over: bool) -> None:
    """An alarm of a full disk stands after it, is told again, and is cleared once; one that was over stays so."""
    first = World(store)
    if is_over:
        first.alarm_manager.look("elbow", "gone", NOON)
        assert first.events() == [AlarmEvent.RAISED]
    wait_until(lambda: not store.waiting())
    with files_up_to(40_000):
        fill(store)
        first.alarm_manager.look("elbow", "" if is_over else "gone", NOON + timedelta(seconds=1))
        assert first.events()[-1] is (AlarmEvent.CLEARED if is_over else AlarmEvent.RAISED)
        first.alarm_manager.close()
        second = World(store, NOON + timedelta(seconds=2), first.alarm_manager.newest)
        assert second.events(again=True)[-1] is first.events()[-1]
    wait_until(lambda: not store.waiting())
    second.alarm_manager.look("elbow", "", NOON + timedelta(seconds=9))
    assert second.events() == ([] if is_over else [AlarmEvent.CLEARED])
    wait_until(lambda: not store.waiting())
    with open_readonly(store.path) as reader:
        assert [change.event for _, change in reader.transitions()] == [AlarmEvent.RAISED, AlarmEvent.CLEARED]
        assert reader.active_alarms() == []


def test_a_joint_that_a_reload_takes_away_on_a_full_disk(store: Store) -> None:
    """Its alarm, which the database has not taken yet, does not stand any longer either."""
    first = World(store)
    first.events()
    wait_until(lambda: not store.waiting())
    with files_up_to(40_000):
        fill(store)
        first.alarm_manager.look("elbow", "gone", NOON + timedelta(seconds=1))
        assert first.events() == [AlarmEvent.RAISED]
        first.alarm_manager.close()
        later, known = NOON + timedelta(seconds=2), first.alarm_manager.newest
        AlarmManager(["wrist"], AlarmOptions(), store, lambda change, again: None, later, known).close()
    wait_until(lambda: not store.waiting())
    with open_readonly(store.path) as reader:
        assert [change.event for _, change in reader.transitions("elbow")] == [AlarmEvent.RAISED, AlarmEvent.CLEARED]


def test_requests_are_taken_up_once(store: Store) -> None:
    """What another program has left in the database is done and answered at the next look, and not at the one after."""
    world = World(store)
    world.alarm_manager.look("elbow", "gone", NOON)
    world.events()
    number = ask(store.path, Request(0, "elbow", Verb.ACK, by="ann"), NOON)
    world.alarm_manager.take_requests(NOON + timedelta(seconds=1))
    world.alarm_manager.take_requests(NOON + timedelta(seconds=2))
    assert world.events() == [AlarmEvent.RAISED, AlarmEvent.ACKNOWLEDGED]
    wait_until(lambda: not store.waiting())
    with open_readonly(store.path) as reader:
        answer = reader.answer(number)
        assert reader.requests() == []
    assert answer is not None
    assert (answer.done, answer.text) == (True, "elbow: device acknowledged")


def test_the_trend_is_asked_of_the_database(store: Store) -> None:
    """Scores that rise from 2 to 6 in 40 days meet level 8 in 20: DEGRADED, after five windows and one question; the
    next question is an hour later."""
    for k in range(800):
        time = NOON - timedelta(days=40 * (1 - k / 800))
        store.add(ScoreRow("elbow", time, 0.25, 2 + 4 * k / 800, 8.0, False))
    wait_until(lambda: not store.waiting())
    world = World(store)
    world.alarm_manager.ask_trend(NOON)
    assert world.events() == [AlarmEvent.RAISED]
    (raised,) = [change for change, _ in world.published if isinstance(change, Transition)]
    assert (raised.event, raised.alarm.severity) == (AlarmEvent.RAISED, Severity.DEGRADED)
    assert "at its limit in 20 days" in raised.alarm.reason
    world.alarm_manager.ask_trend(NOON + timedelta(minutes=59))
    assert len(world.events()) == 1
