"""Campaigns of random faults: one of them, and that the checks can fail."""

from __future__ import annotations

import random
import sqlite3
import subprocess
import threading
from contextlib import closing
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from bench.faults.campaign import run
from bench.faults.world import Witness, World

from lostmotion.daemon.records import Health, JointRow, ScoreRow
from lostmotion.daemon.store import Store

NOON = datetime(2026, 1, 31, 12, tzinfo=UTC)


@pytest.mark.slow
def test_one_campaign_holds() -> None:
    """Four faults against a real service: everything that has to hold does, and scores come again."""
    outcome = run(7)
    assert outcome.failures == []
    assert len(outcome.told) == 4
    assert outcome.scores >= 8


def test_the_witness_notices_what_must_not_be(tmp_path: Path) -> None:
    """A joint that is OK with four sound windows, and a committed score that has gone."""
    path = tmp_path / "history.db"
    with closing(Store(path, "arm")) as store:
        times = [NOON + timedelta(seconds=k) for k in range(4)]
        store.add(*(ScoreRow("elbow", time, 0.25, time.second + 1.0, 8.0, False) for time in times))
        store.add(JointRow("elbow", Health.OK))
    witness = Witness(path)
    witness.close()
    witness.look()
    with closing(sqlite3.connect(path)) as db, db:
        db.execute("DELETE FROM score WHERE score = 2.0")
    witness.look()
    assert any(text.startswith("OK with 4 sound windows") for text in witness.wrong)
    assert "1 committed scores are gone" in witness.wrong


def test_the_witness_holds_no_mixture_against_the_service(tmp_path: Path) -> None:
    """A copy beside the log of the file that it replaces shows a score that it does not hold: until the service has
    noticed nothing is promised of it."""
    path, mixed = tmp_path / "history.db", True
    with closing(Store(path, "arm")) as store:
        store.add(ScoreRow("elbow", NOON, 0.25, 1.0, 8.0, False), ScoreRow("wrist", NOON, 0.25, 2.0, 8.0, False))
    witness = Witness(path, is_mixed=lambda: mixed)
    witness.close()
    witness.look()
    assert witness.seen == {}
    with closing(sqlite3.connect(path)) as db, db:
        db.execute("DELETE FROM score WHERE score = 2.0")
    mixed = False  # read by the witness
    witness.look()
    assert not any("gone" in text for text in witness.wrong)
    assert [*witness.seen.values()] == [{1.0}]


@pytest.mark.parametrize("is_starved", [True, False])
def test_only_a_starved_service_is_begun_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, is_starved: bool
) -> None:
    """As systemd does, whenever it ends; one that ends by itself without lack of memory is a failure that stays."""
    world, started = World(tmp_path, random.Random(1)), threading.Event()
    monkeypatch.setattr(world, "start", started.set)
    with subprocess.Popen(["false"], text=True) as world.process:
        if is_starved:
            world.starve()
        world.process.wait()
        supervisor = threading.Thread(target=world._supervise)
        supervisor.start()
        assert started.wait(10.0 if is_starved else 1.0) is is_starved
        world._ended.set()
        supervisor.join()
