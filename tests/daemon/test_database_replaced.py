"""The database is deleted, replaced or reached by a link while a service runs: real processes, real files."""

from __future__ import annotations

import json
import os
import shutil
import signal
import sqlite3
from collections.abc import Callable
from contextlib import closing
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

from lostmotion.daemon import database as files
from lostmotion.daemon.database import StoreBusyError, is_held
from lostmotion.daemon.inode_lock import InodeLock
from lostmotion.daemon.reader import open_readonly
from lostmotion.daemon.records import AlarmState, ScoreRow
from lostmotion.daemon.store import Store
from tests.daemon.cli_world import call
from tests.daemon.conftest import Running, wait_until
from tests.daemon.fakes import fake_config
from tests.daemon.test_service import count

Start = Callable[..., Running]
NOON = datetime(2026, 1, 31, 12, tzinfo=UTC)


def rows(number: int, first: int = 0) -> list[ScoreRow]:
    """Scores a second apart."""
    return [ScoreRow("elbow", NOON + timedelta(seconds=first + k), 0.25, 1.0, 8.0, False) for k in range(number)]


def running(folder: Path, start: Start) -> tuple[Running, Path]:
    """A service with a few scores on the disk, and its database."""
    path, database = folder / "fake.toml", folder / "state" / "history.db"
    path.write_text(fake_config(database.parent, "[alarm]\noff_delay_s = 0\n"))
    service = start(path)
    service.wait_for("health joint=elbow health=OK")
    wait_until(lambda: count(database) >= 5)
    return service, database


def test_who_reads_in_the_moment_of_a_deletion_finds_nothing(tmp_path: Path) -> None:
    """As a service does that reads its configuration again before it has noticed: it had ended."""
    path = tmp_path / "history.db"
    with closing(Store(path, "fake")) as store:
        store.add(*rows(3))
        wait_until(lambda: count(path) == 3)
        path.unlink()
        with store.reader() as reader:
            assert not list(reader.noises())


@pytest.mark.slow
@pytest.mark.parametrize("with_folder", [False, True])
def test_a_deleted_database(tmp_path: Path, start: Start, with_folder: bool) -> None:
    """Noticed: an alarm that says so, a new file without a gap in its scores, and the joint is OK in it
    once the alarm is over, for the windows that are known are there."""
    service, database = running(tmp_path, start)
    shutil.rmtree(database.parent) if with_folder else database.unlink()
    wait_until(lambda: count(database) >= 5)
    log = service.wait_for("alarm joint=elbow cause=device severity=error event=raised")
    assert f"{database}: was deleted while it was open" in log
    told = json.loads(call("status", "--database", database, "--json").stdout)["joints"][0]
    assert "a new history begins" in told["alarms"][0]["reason"]
    assert service.stop(signal.SIGTERM) == 0
    with open_readonly(database) as reader:
        times = np.array([row.time.timestamp() for row in reader.scores("elbow")])
    assert np.diff(times) == pytest.approx(np.full(len(times) - 1, 0.25), abs=0.02)
    assert "Traceback" not in service.log.read_text()


@pytest.mark.slow
def test_a_reload_before_a_deletion_is_noticed_keeps_the_alarms(tmp_path: Path, start: Start) -> None:
    """An acknowledged alarm is in the new file what it was in the deleted one, raised when it was raised."""
    path, database, missing = tmp_path / "fake.toml", tmp_path / "state" / "history.db", tmp_path / "missing"
    path.write_text(fake_config(database.parent, f'[fake]\nmissing = "{missing}"\n'))
    missing.touch()
    service = start(path)
    service.wait_for("alarm joint=elbow cause=device severity=error event=raised")
    assert call("alarms", "ack", "elbow", "--database", database).exit_code == 0
    with open_readonly(database) as reader:
        (before,) = reader.alarms("elbow", living=True)
    assert before.state is AlarmState.ACKNOWLEDGED
    database.unlink()
    service.process.send_signal(signal.SIGHUP)
    service.wait_for("configuration taken")
    assert service.stop(signal.SIGTERM) == 0
    with open_readonly(database) as reader:
        (after,) = reader.alarms("elbow", living=True)
    assert (after.state, after.raised) == (before.state, before.raised)
    assert service.log.read_text().count("event=raised") == 1


@pytest.mark.slow
def test_a_database_that_is_replaced_by_a_copy(tmp_path: Path, start: Start) -> None:
    """An older copy is moved to its place: the service goes on in it, the older scores are still there, and the log of
    the one that is gone does not get into it."""
    service, database = running(tmp_path, start)
    with closing(Store(tmp_path / "copy.db", "fake")) as store:
        store.add(*rows(3000))
    (tmp_path / "copy.db").rename(database)
    service.wait_for("was replaced by another file while it was open")
    wait_until(lambda: count(database) >= 3010)
    assert service.stop(signal.SIGTERM) == 0
    with closing(sqlite3.connect(database)) as db:
        assert db.execute("PRAGMA integrity_check").fetchall() == [("ok",)]
    with open_readonly(database) as reader:
        assert reader.scores("elbow", until=NOON + timedelta(days=1)) == rows(3000)
        (alarm,) = reader.alarms("elbow", living=True)
    assert alarm.state in (AlarmState.ACTIVE, AlarmState.RETURNED)


def test_what_waits_goes_into_the_new_file(tmp_path: Path) -> None:
    """Rows that were committed to a deleted file, and those after them, are found in the new one: none thrown away."""
    path = tmp_path / "history.db"
    store = Store(path, "fake")
    store.add(*rows(5))
    wait_until(lambda: not store.waiting())
    path.unlink()
    store.add(*rows(54, first=5))
    wait_until(lambda: store.damage is not None)
    assert store.close() == 0
    with open_readonly(path) as reader:
        assert reader.scores("elbow") == rows(54, first=5)


def test_a_link_is_no_other_database(tmp_path: Path) -> None:
    """The second service is refused whichever way it comes, and `status` sees that one runs."""
    path, link = tmp_path / "history.db", tmp_path / "link.db"
    link.symlink_to(path)
    for first, second in ((path, link), (link, path)):
        with closing(Store(first, "fake")):
            assert is_held(second) is True
            with pytest.raises(StoreBusyError, match=r"history\.db: another lostmotion service writes it"):
                Store(second, "fake")
        assert is_held(second) is False


def test_a_hard_link_is_no_other_database(tmp_path: Path) -> None:
    """Two names of one file would have two logs: the second is refused, `status` sees by either that one runs, and a
    backup by a hard link keeps nobody out."""
    path, link = tmp_path / "history.db", tmp_path / "elsewhere" / "link.db"
    Store(path, "fake").close()
    link.parent.mkdir()
    link.hardlink_to(path)
    for first, second in ((path, link), (link, path)):
        with closing(Store(first, "fake")) as store:
            assert is_held(first) is is_held(second) is True
            with pytest.raises(StoreBusyError, match=r"writes the same file by another name \(a hard link\)"):
                Store(second, "fake")
            store.add(*rows(5))
        assert not is_held(second)
    with open_readonly(path) as reader:
        assert reader.scores("elbow") == rows(5)


@pytest.mark.slow
def test_a_second_service_by_a_hard_link(tmp_path: Path, start: Start) -> None:
    """Two processes, each with a configuration of its own: the second ends, the first goes on; after
    SIGHUP a service that is pointed at another name of its own file keeps the old configuration."""
    service, database = running(tmp_path, start)
    link, other = tmp_path / "link.db", tmp_path / "other.toml"
    link.hardlink_to(database)
    other.write_text(fake_config(tmp_path).replace("history.db", "link.db"))
    second = start(other)
    assert second.process.wait(60) != 0
    assert f"{link}: another lostmotion service writes the same file" in second.log.read_text()
    shutil.copy(other, tmp_path / "fake.toml")
    service.process.send_signal(signal.SIGHUP)
    service.wait_for(f"the old configuration stays: {link}: another lostmotion service writes the same file")
    before = count(database)
    wait_until(lambda: count(database) > before + 1)
    with closing(sqlite3.connect(database)) as db:
        db.execute("SELECT count(*) FROM score").fetchone()
    assert database.with_name("history.db-wal").exists()  # SQLite's locks are alive: a reader is not the last to close
    assert service.stop(signal.SIGTERM) == 0
    assert not link.with_name("link.db-wal").exists()


@pytest.mark.parametrize("damaged", [False, True])
def test_the_lock_goes_with_the_file(tmp_path: Path, damaged: bool) -> None:
    """Of a database that was replaced or moved aside the new file is held, and the old one is not any more."""
    path, old, new = (tmp_path / name for name in ("history.db", "old.db", "new.db"))
    store = Store(path, "fake")
    store.add(*rows(5))
    wait_until(lambda: not store.waiting())
    if damaged:
        store.damage = sqlite3.DatabaseError("malformed")
    else:
        path.rename(old)
        store.look()
    store.begin_anew(rows(5))
    wait_until(lambda: not store.waiting())
    new.hardlink_to(path)
    with pytest.raises(StoreBusyError):
        Store(new, "fake")
    if damaged:
        (aside,) = tmp_path.glob("history.db.damaged-*[0-9]")
        aside.rename(old)
    Store(old, "fake").close()
    assert store.close() == 0
    Store(new, "fake").close()


@pytest.mark.skipif(os.geteuid() != 0, reason="needs two users")
def test_a_stranger_cannot_keep_a_service_out(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """Any user may take the name of a lock: one who may not write the database is not believed."""
    path = tmp_path / "history.db"
    path.touch()
    found = path.stat()
    os.seteuid(65534)
    try:
        stranger = InodeLock((found.st_dev, found.st_ino), found.st_uid)
    finally:
        os.seteuid(0)
    with closing(stranger):
        assert not is_held(path)
        Store(path, "fake").close()
    assert "another user has taken its lock" in caplog.text


def test_damage_moves_the_file_and_not_the_link(tmp_path: Path) -> None:
    """The link still leads to the database, which is the new one; the damaged file lies where it was, renamed."""
    folder, link = tmp_path / "disk", tmp_path / "link.db"
    folder.mkdir()
    link.symlink_to(folder / "history.db")
    (folder / "history.db").write_bytes(b"\xff" * 8192)
    with closing(Store(link, "fake")) as store:
        store.add(*rows(5))
    assert link.is_symlink()
    (aside,) = folder.glob("history.db.damaged-*")
    assert aside.read_bytes() == b"\xff" * 8192
    with open_readonly(link) as reader:
        assert reader.scores("elbow") == rows(5)


def test_a_link_that_leads_elsewhere(tmp_path: Path) -> None:
    """A link that is turned to another file is a replaced database: the rows go where it leads now."""
    link = tmp_path / "link.db"
    link.symlink_to(tmp_path / "one.db")
    store = Store(link, "fake")
    store.add(*rows(5))
    wait_until(lambda: not store.waiting())
    link.unlink()
    link.symlink_to(tmp_path / "two.db")
    store.look()
    store.add(*rows(3, first=5))
    assert store.close() == 0
    for name, expected in (("one.db", rows(5)), ("two.db", rows(3, first=5))):
        with open_readonly(tmp_path / name) as reader:
            assert reader.scores("elbow")[-3:] == expected[-3:]


@pytest.mark.parametrize("wrong", ["pipe", "folder"])
def test_a_link_that_is_set_right_again(tmp_path: Path, wrong: str) -> None:
    """A link that is set to a pipe or a folder while the service runs: nothing is made beside that, and the rows that
    wait go to the file to which the link leads next."""
    link, other = tmp_path / "history.db", tmp_path / "other.db"
    (tmp_path / "folder").mkdir()
    os.mkfifo(tmp_path / "pipe")
    with closing(Store(link, "fake")) as store:
        store.add(*rows(3))
        wait_until(lambda: count(link) == 3)
        link.unlink()
        link.symlink_to(tmp_path / wrong)
        store.look()
        store.add(*rows(3, first=3))
        store.begin_anew([])
        wait_until(lambda: "expected a file" in store.problem)
        link.unlink()
        link.symlink_to(other)
        wait_until(lambda: count(other) == 3)
    assert not (tmp_path / f"{wrong}.lock").exists()


def test_nobody_gets_in_while_the_file_changes(tmp_path: Path) -> None:
    """The lock is held from the deleted file to the new one, what is known comes first, and rows are taken on."""
    path = tmp_path / "history.db"
    store = Store(path, "fake")
    store.add(*rows(5))
    wait_until(lambda: not store.waiting())
    held = (path.parent / "history.db.lock").stat().st_ino
    path.unlink()
    store.look()
    store.add(*rows(3, first=5))
    store.begin_anew(rows(5))
    with pytest.raises(StoreBusyError):
        Store(path, "fake")
    assert (path.parent / "history.db.lock").stat().st_ino == held
    store.add(*rows(2, first=8))
    assert store.close() == 0
    with open_readonly(path) as reader:
        assert reader.scores("elbow") == rows(10)


def test_it_is_told_when_the_old_log_is_gone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Who reads the file from the line on finds nothing of the one that was replaced, whose log lay beside it."""
    path, there = tmp_path / "history.db", list[bool]()
    wal = path.with_name("history.db-wal")
    monkeypatch.setattr(files.log, "error", lambda *_: there.append(wal.exists()))
    path.touch()
    wal.touch()
    files.leave(path, files.ReplacedError("replaced"), files.file_identity(wal))
    assert there == [False]
