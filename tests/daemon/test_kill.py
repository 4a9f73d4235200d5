"""kill -9 at any moment: what a reader has seen stays, the database is sound, the service starts again."""

from __future__ import annotations

import random
import signal
import sqlite3
import time
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import pytest

from tests.daemon.alarm_world import Watcher, broken_links, restless_config, stored
from tests.daemon.conftest import Running, wait_until
from tests.daemon.fakes import fake_config
from tests.daemon.zenoh_world import session

KILLS = 12
ALARM_KILLS = 8


@pytest.mark.slow
def test_no_committed_score_is_lost(tmp_path: Path, start: Callable[..., Running]) -> None:
    """Twelve kills at random moments, some while starting, most while writing (bench.alarms has more)."""
    database, seen = tmp_path / "history.db", set[tuple[str, str, float]]()
    (tmp_path / "fake.toml").write_text(fake_config(tmp_path, joints=[f"j{k}" for k in range(12)]))
    moments = random.Random(1)
    for kill in range(KILLS):
        service = start(tmp_path / "fake.toml")
        if kill % 5:
            service.wait_for("started")
        end = time.monotonic() + moments.uniform(0.0, 1.2)
        while time.monotonic() < end:
            seen |= committed(database)
            time.sleep(0.003)
        service.process.kill()
        service.process.wait()
        assert seen <= committed(database), f"after kill {kill}"
    service = start(tmp_path / "fake.toml")
    before = len(committed(database))
    wait_until(lambda: len(committed(database)) > before)
    assert before >= len(seen) > 2 * KILLS
    with closing(sqlite3.connect(database)) as db:
        assert db.execute("PRAGMA integrity_check").fetchall() == [("ok",)]


@pytest.mark.slow
def test_no_transition_of_an_alarm_is_lost_or_repeated(
    tmp_path: Path, start: Callable[..., Running], endpoint: str
) -> None:
    """Eight kills among alarms that never rest: what was stored stays, each transition follows from the one before,
    and a subscriber that recovers has heard exactly those that are stored."""
    database, path, seen = tmp_path / "history.db", tmp_path / "fake.toml", set[str]()
    path.write_text(restless_config(tmp_path, f'[alarm.zenoh]\nmode = "client"\nconnect = ["{endpoint}"]\n'))
    moments = random.Random(2)
    with session("router", listen=[endpoint]), closing(Watcher(endpoint, tmp_path / "watched")) as watcher:
        for kill in range(ALARM_KILLS):
            service = start(path)
            if kill % 5:
                service.wait_for("started")
            end = time.monotonic() + moments.uniform(0.0, 2.0)
            while time.monotonic() < end:
                seen |= {transition.id for transition in stored(database)}
                time.sleep(0.01)
            service.process.kill()
            service.process.wait()
            assert seen <= {transition.id for transition in stored(database)}, f"after kill {kill}"
        service = start(path)
        service.wait_for("zenoh: session open")
        assert service.stop(signal.SIGTERM) == 0
        transitions = stored(database)
        wait_until(lambda: len(watcher.ids) >= len(transitions))
        assert sorted(watcher.ids) == sorted(transition.id for transition in transitions)
    assert broken_links(transitions) == []
    assert len(transitions) > 3 * ALARM_KILLS


def committed(database: Path) -> set[tuple[str, str, float]]:
    """All scores that a reader sees."""
    if not database.exists():
        return set()
    with closing(sqlite3.connect(f"{database.as_uri()}?mode=ro", uri=True)) as db:
        if db.execute("PRAGMA user_version").fetchone()[0] == 0:
            return set()
        return set(db.execute("SELECT joint, time, score FROM scores"))
