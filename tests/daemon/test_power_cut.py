"""A power cut: what SQLite had not yet forced to the disk is gone, or half there."""

from __future__ import annotations

import random
import shutil
import sqlite3
from contextlib import closing
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from lostmotion.daemon.records import ScoreRow
from lostmotion.daemon.store import Store
from tests.daemon.conftest import wait_until

START = datetime(2026, 1, 1, tzinfo=UTC)
BATCHES, ROWS, CUTS = 12, 40, 40


@pytest.mark.slow
def test_a_database_opens_after_a_power_cut(tmp_path: Path) -> None:
    """The write-ahead log cut off, or torn, at any byte: the database opens, is sound, and holds the oldest scores."""
    store = Store(tmp_path / "history.db", "arm1")
    for batch in range(BATCHES):
        times = (START + timedelta(seconds=batch * ROWS + k) for k in range(ROWS))
        store.add(*(ScoreRow("elbow", time, 0.25, 5.0, 8.0, False) for time in times))
        wait_until(lambda: store.waiting() == 0)
    moments, kept = random.Random(1), set[int]()
    for cut in range(CUTS):
        kept.add(len(after_cut(tmp_path, tmp_path / f"cut{cut}", moments)))
    store.close()
    assert len(kept) > BATCHES / 2  # cuts fell between many batches
    assert max(kept) <= BATCHES * ROWS


def after_cut(source: Path, folder: Path, moments: random.Random) -> list[str]:
    """The scores that are left of an open database whose log ends somewhere, the last bytes torn every other time."""
    folder.mkdir()
    shutil.copy(source / "history.db", folder)
    log = (source / "history.db-wal").read_bytes()
    log = log[: moments.randrange(len(log))]
    if moments.random() < 0.5:
        log = log[:-200] + moments.randbytes(min(200, len(log)))
    (folder / "history.db-wal").write_bytes(log)
    assert Store(folder / "history.db", "arm1").close() == 0
    assert not list(folder.glob("*.damaged-*"))
    with closing(sqlite3.connect(folder / "history.db")) as db:
        assert db.execute("PRAGMA integrity_check").fetchall() == [("ok",)]
        times = [time for (time,) in db.execute("SELECT time FROM scores ORDER BY time")]
    expected = [f"{START + timedelta(seconds=k):%Y-%m-%dT%H:%M:%S}.000000Z" for k in range(len(times))]
    assert times == expected
    return times
