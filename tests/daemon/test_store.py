"""The database: what goes in comes out, and what happens when it cannot."""

from __future__ import annotations

import logging
import math
import os
import re
import sqlite3
import time
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

import msgspec
import numpy as np
import pytest
import sqlite_utils

from lostmotion.daemon import database
from lostmotion.daemon import store as storing
from lostmotion.daemon.database import StoreError
from lostmotion.daemon.lifecycle import happen, raised
from lostmotion.daemon.migrations import CURRENT, MIGRATIONS
from lostmotion.daemon.reader import ReaderError, open_readonly
from lostmotion.daemon.records import (
    EPOCH,
    AlarmEvent,
    AlarmState,
    Cause,
    DeviceRow,
    Health,
    JointRow,
    ScoreRow,
    Severity,
    Transition,
    WindowRow,
)
from lostmotion.daemon.store import Store
from lostmotion.daemon.writer import Policy, Row, Writer
from tests.daemon.conftest import SmallDisk, wait_until
from tests.daemon.fakes import files_may_grow, files_up_to

NOON = datetime(2026, 1, 31, 12, 0, 0, 123456, tzinfo=UTC)
FULL = ScoreRow(
    "elbow", NOON, 0.25, 17.5, 8.0, True, 1e-3, 9e-4, 1.1e-3, 12.0, 41.0, "clipped", 1.2e-3, 8e-4, 2e-3, 17.5, 11.0
)
BARE = ScoreRow("elbow", NOON + timedelta(seconds=1), 0.25, math.nan, 8.0, False)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """Where the database of a test lies."""
    return tmp_path / "history.db"


def filled(path: Path, *rows: storing.Row, keep_windows_mb: float = 100.0) -> Path:
    """A database with these rows, closed again."""
    store = Store(path, "arm1", keep_windows_mb)
    for row in rows:
        store.add(row)
    store.close()
    return path


def scores(count: int, joint: str = "elbow") -> list[ScoreRow]:
    """Scores a second apart whose values are 0, 1, 2 …"""
    return [ScoreRow(joint, NOON + timedelta(seconds=k), 0.25, float(k), 8.0, k > 8) for k in range(count)]


def raw_window(second: int, impact: bool, samples: int = 250) -> WindowRow:
    """A kept window."""
    return WindowRow("elbow", NOON + timedelta(seconds=second), impact, 1000.0, 2e-4, np.full(samples, 1.5, np.float32))


def test_scores_come_back_as_they_went_in(path: Path) -> None:
    """All fields, NaN as NaN; oldest first; a limit takes the newest; since is inside, until outside."""
    rows = [FULL, BARE, msgspec.structs.replace(FULL, time=NOON + timedelta(seconds=2))]
    with open_readonly(filled(path, *reversed(rows))) as reader:
        found = reader.scores("elbow")
        assert [row.time for row in found] == [row.time for row in rows]
        assert found[0] == FULL
        assert math.isnan(found[1].score)
        assert math.isnan(found[1].play)
        assert found[1].quality == "ok"
        assert [row.time for row in reader.scores("elbow", limit=2)] == [row.time for row in rows[1:]]
        assert reader.scores("elbow", since=rows[1].time, until=rows[2].time)[0].time == rows[1].time
        assert len(reader.scores("elbow", since=rows[1].time, until=rows[2].time)) == 1
        assert reader.scores("nobody") == []
        assert reader.last_window("elbow") == rows[2]
        assert reader.robot() == "arm1"


def test_others_read_iso_times_and_plain_columns(path: Path) -> None:
    """A program that knows nothing of lostmotion reads the documented columns, with UTC text and NULL for unknown."""
    alarm = raised("elbow", Cause.PLAY, Severity.WARNING, "play: much", NOON)
    database = sqlite_utils.Database(filled(path, FULL, BARE, alarm, raw_window(5, True)))
    rows = list(database.query("SELECT * FROM scores ORDER BY time"))
    assert list(rows[0]) == [
        "joint", "time", "score", "level", "impact", "play", "play_low", "play_high", "severity", "severity_low",
        "severity_high", "excitation", "temperature", "quality", "duration", "band", "ringdown",
    ]  # fmt: skip
    assert rows[0]["time"] == "2026-01-31T12:00:00.123456Z"
    assert (rows[1]["score"], rows[1]["play"], rows[1]["quality"]) == (None, None, "ok")
    found = next(iter(database.query("SELECT * FROM alarms")))
    assert found["state"] == "active"
    assert found["raised"] == "2026-01-31T12:00:00.123456Z"
    assert (found["acknowledged"], found["cleared"]) == (None, None)
    event = next(iter(database.query("SELECT * FROM alarm_events")))
    assert (event["id"], event["event"], event["time"]) == (alarm.id, "raised", found["raised"])
    window = next(iter(database.query("SELECT * FROM windows")))
    assert np.frombuffer(window["accel"], "<f4").tolist() == [1.5] * 250
    assert next(iter(database.query("SELECT name, health FROM joints"))) == {"name": "elbow", "health": "OK"}


def later(transition: Transition, event: AlarmEvent, minutes: float, **more: object) -> Transition:
    """What happens next to the same alarm."""
    return happen(transition.alarm, event, transition.time + timedelta(minutes=minutes), **more)  # type: ignore[arg-type]


def test_an_alarm_is_one_row_from_raising_until_it_is_normal(path: Path) -> None:
    """Each transition updates the raised row and is kept; shelved, returned and normal alarms are not active."""
    alarm = raised("elbow", Cause.DEVICE, Severity.ERROR, "no data", NOON)
    shelved = later(alarm, AlarmEvent.SHELVED, 1, until=NOON + timedelta(days=1), by="ann")
    other = raised("wrist", Cause.DEVICE, Severity.ERROR, "no data", NOON)
    known = later(other, AlarmEvent.ACKNOWLEDGED, 1)
    normal = later(known, AlarmEvent.CLEARED, 1)
    with open_readonly(filled(path, alarm, shelved, other, known)) as reader:
        assert reader.alarms("elbow") == [shelved.alarm]
        assert reader.active_alarms() == [known.alarm]
        assert [row for _, row in reader.transitions("elbow")] == [alarm, shelved]
    with open_readonly(filled(path, normal)) as reader:
        assert reader.alarms(living=True) == [shelved.alarm]
        assert len(reader.alarms()) == 2
        assert [row for _, row in reader.transitions(newest=2)] == [known, normal]


def test_a_transition_told_twice_is_stored_once(path: Path) -> None:
    """A recording replayed into the same database brings the same transitions: each stays one row."""
    alarm = raised("elbow", Cause.PLAY, Severity.WARNING, "much", NOON)
    with open_readonly(filled(path, alarm, alarm)) as reader:
        assert [row for _, row in reader.transitions()] == [alarm]
        assert len(reader.alarms()) == 1


def test_a_transition_is_settled_once_it_is_stored(path: Path) -> None:
    """Nothing is settled before it is committed, then each once and in order, also one whose score came just before."""
    with closing(Store(path, "arm1")) as store, store.reader() as reader:
        alarms = [raised(f"j{k}", Cause.PLAY, Severity.WARNING, "much", NOON) for k in range(3)]
        for alarm in alarms:
            store.add(FULL, alarm)
            assert store.settled(5.0) == [alarm]
            assert reader.transitions()[-1][1] == alarm
        assert store.settled() == []


def test_a_full_disk_keeps_no_alarm_from_people(path: Path) -> None:
    """What the disk refuses is settled all the same, also behind a backlog, and not again when it is stored."""
    with closing(Store(path, "arm1")) as store:
        with files_up_to(40_000):
            store.add(*scores(12_000))
            wait_until(lambda: store.problem)
            alarm = raised("elbow", Cause.PLAY, Severity.WARNING, "much", NOON)
            store.add(alarm)
            assert store.settled(5.0) == [alarm]
        wait_until(lambda: not store.waiting())
        assert store.settled() == []
    with open_readonly(path) as reader:
        assert reader.active_alarms() == [alarm.alarm]


def test_a_sample_of_many_scores(path: Path) -> None:
    """One score from each of equal spans: the first; spans without a sound one are left out."""
    doubtful = msgspec.structs.replace(FULL, time=NOON + timedelta(seconds=500))
    with open_readonly(filled(path, *scores(100), doubtful)) as reader:
        found = reader.sampled("elbow", NOON, NOON + timedelta(seconds=1000), 100)
    assert [row.score for row in found] == [float(k) for k in range(0, 100, 10)]


def test_health_and_devices_are_the_newest_ones(path: Path) -> None:
    """A later row replaces the earlier one of the same name."""
    device = DeviceRow("tip", NOON, "reading", "", 10, 1, 2, 3, 4, 5)
    bad = JointRow("elbow", Health.ERROR, "unplugged", NOON)
    with open_readonly(filled(path, JointRow("elbow"), device, bad, replace(device, samples=99))) as reader:
        assert reader.joints() == [bad]
        assert reader.devices() == [replace(device, samples=99)]


def test_a_score_is_readable_by_others_soon(path: Path) -> None:
    """Without any further call the writer commits what it was given."""
    with closing(Store(path, "arm1")) as store, open_readonly(path) as reader:
        store.add(FULL)
        wait_until(lambda: reader.scores("elbow"), 5.0)


def test_rows_are_written_when_that_is_asked_for(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """``flush`` does not wait for the next time that the writer looks."""
    monkeypatch.setattr(storing, "FLUSH_S", 3600.0)
    with closing(Store(path, "arm1")) as store, open_readonly(path) as reader:
        store.add(FULL)
        store.flush()
        wait_until(lambda: reader.scores("elbow"), 20.0)


def test_raw_windows_stay_below_their_limit(path: Path) -> None:
    """The oldest windows without an impact go first, then the oldest with one; the newest impact stays."""
    rows = [raw_window(second, impact=second % 2 == 0) for second in range(40)]
    filled(path, *rows, keep_windows_mb=0.02)
    with closing(sqlite3.connect(path)) as db:
        assert db.execute("SELECT sum(length(accel)) FROM windows").fetchone()[0] <= 20_000
        kept = [row[0] for row in db.execute("SELECT impact FROM windows ORDER BY time")]
        assert sum(kept) == 19 or sum(kept) == 20
        newest = db.execute("SELECT max(time) FROM windows WHERE impact").fetchone()[0]
        assert newest == "2026-01-31T12:00:38.123456Z"
    filled(path, raw_window(50, True), keep_windows_mb=0.002)
    with closing(sqlite3.connect(path)) as db:
        assert db.execute("SELECT time FROM windows").fetchall() == [("2026-01-31T12:00:50.123456Z",)]


def test_a_score_takes_few_bytes_and_is_found_by_index(path: Path) -> None:
    """Ten million scores stay below one GB, and the history of a joint is a search, not a scan."""
    usual = msgspec.structs.replace(
        FULL, play=math.nan, play_low=math.nan, play_high=math.nan, excitation=12.3, quality="ok"
    )
    filled(path, *[msgspec.structs.replace(usual, time=NOON + timedelta(seconds=k)) for k in range(20_000)])
    with closing(sqlite3.connect(path)) as db:
        size = db.execute("SELECT sum(pgsize) FROM dbstat WHERE name = 'score'").fetchone()[0]
        asked = {"joint": "elbow", "since": 0, "until": 2**62, "limit": 10}
        plan = [row[3] for row in db.execute("EXPLAIN QUERY PLAN " + storing.Reader.SCORES, asked)]
    assert size / 20_000 < 100, size
    assert plan[0] == "SEARCH score USING PRIMARY KEY (joint_id=? AND time_us>? AND time_us<?)"
    assert not [step for step in plan if step.startswith("SCAN")]


def assert_of_old(rows: Sequence[ScoreRow]) -> None:
    """These are the one score of an older database: its severity and other statistics are unknown."""
    assert {row.score for row in rows} == {3.5}
    for row in rows:
        added = (row.severity, row.severity_low, row.severity_high, row.band, row.ringdown)
        assert np.isnan(added).all()


def test_a_database_of_version_1_is_brought_up_to_date(path: Path) -> None:
    """Scores survive the migration, the new table is there, and a copy of the old file stays."""
    with closing(sqlite3.connect(path)) as db:
        db.executescript(MIGRATIONS[0] + "PRAGMA user_version = 1;")
        db.execute("INSERT INTO joint (id, name) VALUES (1, 'elbow')")
        db.execute("INSERT INTO score VALUES (1, 1000000, 250000, 3.5, 8.0, 0, NULL, NULL, NULL, NULL, NULL, NULL)")
        db.commit()
    with open_readonly(path) as reader:
        assert reader.devices() == []
        assert_of_old([*reader.scores("elbow"), *reader.sampled("elbow", EPOCH, NOON, 1)])
        assert reader.series("elbow")["severity"].tolist() == [math.inf]
    filled(path, DeviceRow("tip", NOON, "reading", "", 10, 1, 2, 3, 4, 5))
    with open_readonly(path) as reader:
        assert_of_old(reader.scores("elbow"))
        assert [row.name for row in reader.devices()] == ["tip"]
    with closing(sqlite3.connect(path)) as db, closing(sqlite3.connect(f"{path}.version1")) as old:
        assert db.execute("PRAGMA user_version").fetchone()[0] == CURRENT
        assert old.execute("PRAGMA user_version").fetchone()[0] == 1
        assert old.execute("SELECT score FROM scores").fetchone()[0] == 3.5


def test_alarms_of_an_older_database_are_kept(path: Path) -> None:
    """Schema 2 knew active and cleared: they become active, acknowledged and normal, with all their times."""
    with closing(sqlite3.connect(path)) as db:
        db.executescript("".join(MIGRATIONS[:2]) + "PRAGMA user_version = 2;")
        db.execute("INSERT INTO joint (id, name) VALUES (1, 'elbow')")
        times = [(1_000_000, None, None), (2_000_000, 2_500_000, None), (3_000_000, None, 4_000_000)]
        for moments in times:
            values = (1, "play", "warning", *moments, "much")
            db.execute(
                "INSERT INTO alarm (joint_id, cause, severity, raised_us, acknowledged_us, cleared_us, reason)"
                " VALUES (?, ?, ?, ?, ?, ?, ?)",
                values,
            )
        db.commit()
    with open_readonly(filled(path)) as reader:
        alarms = reader.alarms("elbow")
    assert [alarm.state for alarm in alarms] == [AlarmState.ACTIVE, AlarmState.ACKNOWLEDGED, AlarmState.NORMAL]
    assert [alarm.notified.timestamp() for alarm in alarms] == [1.0, 2.0, 3.0]


def test_a_migration_under_a_lock_makes_one_copy(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """While another program writes nothing is copied, however often it is tried; afterwards there is one copy."""
    monkeypatch.setattr("lostmotion.daemon.database.BUSY_S", 0.01)
    monkeypatch.setattr("lostmotion.daemon.store.RETRY_S", 0.02)
    copied = list[Path]()
    monkeypatch.setattr("lostmotion.daemon.database._copy", lambda db, path, version: copied.append(path))
    with closing(sqlite3.connect(path)) as db:
        db.executescript("".join(MIGRATIONS[:2]) + "PRAGMA journal_mode = WAL; PRAGMA user_version = 2;")
    with closing(sqlite3.connect(path)) as other:
        other.execute("BEGIN IMMEDIATE")
        store = Store(path, "arm1", patient=True)
        store.add(FULL)
        time.sleep(0.5)
        assert (store.is_open, copied) == (False, [])
        other.rollback()
        wait_until(lambda: store.is_open and not store.waiting())
    assert store.close() == 0
    assert copied == [path]


def test_a_new_database_is_not_for_everybody(path: Path) -> None:
    """Owner and group, less by the umask; the log beside it and the copy before a migration too; an old file's stay."""
    for mask, mode in ((0o022, 0o640), (0o077, 0o600)):
        before = os.umask(mask)
        try:
            database = path.with_name(f"{mask:o}.db")
            with closing(sqlite3.connect(database)) as db:
                db.executescript("".join(MIGRATIONS[:2]) + "PRAGMA user_version = 2;")
            database.chmod(0o644)
            filled(database, FULL)
            assert database.stat().st_mode & 0o777 == 0o644
            assert database.with_name(f"{database.name}.version2").stat().st_mode & 0o777 == mode
            store = Store(path.with_name(f"{mask:o}-new.db"), "arm1")
            store.add(FULL)
            wait_until(lambda store=store: not store.waiting())
            assert {file.stat().st_mode & 0o777 for file in path.parent.glob(f"{mask:o}-new.db*[!k]")} == {mode}
            store.close()
        finally:
            os.umask(before)


@pytest.mark.slow
def test_a_log_that_a_reader_lets_grow_is_told(
    path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """A transaction that another program keeps open: one line with the size; when it ends the log is small again."""
    monkeypatch.setattr("lostmotion.daemon.store.MOST_WAL_BYTES", 2_000_000)
    monkeypatch.setattr("lostmotion.daemon.database.WAL_BYTES", 1_000_000)
    caplog.set_level(logging.WARNING)
    store = Store(path, "arm1")
    with closing(sqlite3.connect(path)) as other:
        other.execute("BEGIN")
        other.execute("SELECT count(*) FROM score").fetchone()
        store.add(*scores(100_000))
        wait_until(lambda: not store.waiting())
        (line,) = [line for line in caplog.messages if "has grown" in line]
        assert re.search(r"history\.db-wal: has grown to \d+ MB: another program keeps a transaction open", line)
    store.add(*scores(5000))
    wait_until(lambda: not store.waiting())
    store.add(FULL)
    wait_until(lambda: "is small again" in caplog.text)
    store.close()


def test_a_newer_database_is_refused_and_untouched(path: Path) -> None:
    """The message says which versions were found and expected, and names the copy made before the change, if any."""
    filled(path, FULL)
    with closing(sqlite3.connect(path)) as db:
        db.execute("PRAGMA user_version = 99")
    for copies, words in (([], "install that one$"), ([1, 2, 98], r"or go back to history.db.version2 beside it")):
        for version in copies:
            path.with_name(f"history.db.version{version}").touch()
        for opening in (lambda: Store(path, "arm1"), lambda: open_readonly(path)):
            with pytest.raises((StoreError, ReaderError), match=f"version 99, expected .*newer lostmotion.*{words}"):
                opening()


def test_another_programs_database_is_refused(path: Path) -> None:
    """A sound database that is not ours is not touched; a reader refuses what is no database at all."""
    with closing(sqlite3.connect(path)) as db:
        db.execute("CREATE TABLE photos (name)")
    with pytest.raises(StoreError, match="database of another program"):
        Store(path, "arm1")
    path.write_text("time,score\n" * 1000)
    with pytest.raises(ReaderError, match="is it a database of lostmotion"):
        open_readonly(path)


@pytest.mark.parametrize(("start", "length"), [(0, 4096), (100, 8092)], ids=["header", "pages"])
def test_a_damaged_database_is_moved_aside(
    path: Path, caplog: pytest.LogCaptureFixture, start: int, length: int
) -> None:
    """Overwritten bytes: the file stays under another name, an error says so, and the store works in a new one."""
    filled(path, *scores(5000))
    data = bytearray(path.read_bytes())
    data[start : start + length] = b"\xff" * length
    path.write_bytes(bytes(data))
    with pytest.raises(ReaderError, match=r"damaged: `lostmotion run` moves it aside|is it a database of lostmotion"):
        open_readonly(path)
    filled(path, FULL)
    with open_readonly(path) as reader:
        assert [row.score for row in reader.scores("elbow")] == [FULL.score]
    (aside,) = path.parent.glob("history.db.damaged-*")
    assert aside.read_bytes() == bytes(data)
    (said,) = (record for record in caplog.records if record.levelno == logging.ERROR)
    assert f"a new history begins, the old file is {aside.name}" in said.getMessage()


def test_a_disk_that_takes_scores_and_no_windows_is_told_once(
    path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """It is nearly full: with every score it is well, with every window it is not."""
    commit = Writer.commit

    def nearly_full(writer: Writer, rows: Sequence[Row], policy: Policy) -> None:
        if any(isinstance(row, WindowRow) for row in rows):
            raise sqlite3.OperationalError("database or disk is full")
        commit(writer, rows, policy)

    monkeypatch.setattr(storing, "RETRY_S", 0.01)
    monkeypatch.setattr(storing, "FLUSH_S", 0.01)
    with closing(Store(path, "arm1")) as store:
        monkeypatch.setattr(Writer, "commit", nearly_full)
        store.add(raw_window(0, impact=True))
        for row in scores(10):
            wait_until(lambda: store.problem)
            store.add(row)
            wait_until(lambda: store.waiting() == 1)
        wait_until(lambda: store.problem)
        monkeypatch.setattr(Writer, "commit", commit)
    assert [caplog.text.count(words) for words in ("wait in memory", "written again")] == [1, 1]


def test_scores_and_raw_windows_are_committed_together(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One transaction, not two; after the disk has refused one, the scores come first."""
    commit, batches = Writer.commit, []
    refused = iter([True, False, False, False])

    def counted(writer: Writer, rows: Sequence[Row], policy: Policy) -> None:
        batches.append({type(row) for row in rows})
        if next(refused):
            raise sqlite3.OperationalError("database or disk is full")
        commit(writer, rows, policy)

    monkeypatch.setattr(storing, "RETRY_S", 0.01)
    with closing(Store(path, "arm1")) as store:
        monkeypatch.setattr(Writer, "commit", counted)
        for expected in ([{ScoreRow, WindowRow}, {ScoreRow}, {WindowRow}], [{ScoreRow, WindowRow}]):
            batches.clear()
            store.add(FULL, raw_window(0, impact=True))
            wait_until(lambda: not store.waiting())
            assert batches == expected
        monkeypatch.setattr(Writer, "commit", commit)


@pytest.mark.parametrize("table", ["score", "joint", "alarm", "alarm_event", "device", "request_that_waits"])
def test_a_page_that_a_service_begins_with_is_looked_at(path: Path, table: str) -> None:
    """A damaged one is met when the store is opened, and not by the service afterwards, which would end."""
    filled(path, *scores(5000))
    with closing(sqlite3.connect(path)) as db:
        root = db.execute("SELECT rootpage FROM sqlite_schema WHERE name = ?", [table]).fetchone()[0]
        size = db.execute("PRAGMA page_size").fetchone()[0]
    with path.open("r+b") as file:
        file.seek((root - 1) * size)
        file.write(b"\xff" * size)
    filled(path, FULL)
    assert len([*path.parent.glob("history.db.damaged-*")]) == 1
    with open_readonly(path) as reader:
        assert [row.score for row in reader.scores("elbow")] == [FULL.score]


@pytest.mark.parametrize(
    ("old", "new"),
    [
        (b"reminders", b"remind\xffrs"),  # a schema that is no UTF-8, which SQLite's module cannot even complain about
        (b"excitation", b"excitatiom"),  # a column that is not there
        (b"returned", b"returneb"),  # a state that there is not
    ],
)
def test_a_database_whose_bytes_have_turned_begins_anew(path: Path, old: bytes, new: bytes) -> None:
    """Sound pages, but not what was written: a service would end at its start."""
    alarm = raised("elbow", Cause.PLAY, Severity.WARNING, "much", NOON)
    filled(path, *scores(50), alarm, happen(alarm.alarm, AlarmEvent.CLEARED, NOON + timedelta(minutes=1)))
    spoilt = path.read_bytes().replace(old, new)
    assert spoilt != path.read_bytes()
    path.write_bytes(spoilt)
    filled(path, FULL)
    assert len([*path.parent.glob("history.db.damaged-*")]) == 1
    with open_readonly(path) as reader:
        assert [row.score for row in reader.scores("elbow")] == [FULL.score]


def test_alarms_outlive_a_damaged_history(path: Path) -> None:
    """Where the scores cannot be read any more, the new database has the alarms that are not over, acknowledged ones as
    such, the health of their joints, and the name of the robot."""
    alarm = raised("elbow", Cause.PLAY, Severity.WARNING, "much", NOON)
    seen = happen(alarm.alarm, AlarmEvent.ACKNOWLEDGED, NOON + timedelta(minutes=1), by="Ada")
    gone = raised("knee", Cause.PLAY, Severity.WARNING, "much", NOON)
    over = happen(
        happen(gone.alarm, AlarmEvent.ACKNOWLEDGED, NOON).alarm, AlarmEvent.CLEARED, NOON + timedelta(minutes=2)
    )
    health = JointRow("elbow", Health.WARNING, "much", NOON)
    filled(path, *scores(5000), health, alarm, seen, gone, over)
    with closing(sqlite3.connect(path)) as db:
        root = db.execute("SELECT rootpage FROM sqlite_schema WHERE name = 'score'").fetchone()[0]
        size = db.execute("PRAGMA page_size").fetchone()[0]
    with path.open("r+b") as file:
        file.seek((root - 1) * size)
        file.write(b"\xff" * size)
    with closing(Store(path, "arm1")) as store:
        assert "is damaged" in store.began_anew
    with open_readonly(path) as reader:
        assert reader.robot() == "arm1"
        (kept,) = reader.alarms(living=True)
        assert (kept.joint, kept.state, kept.raised) == ("elbow", AlarmState.ACKNOWLEDGED, NOON)
        assert reader.joints() == [health]
        assert reader.scores("elbow") == []


def test_damage_among_as_many_scores_as_a_service_may_go_on_from_is_found_at_the_start(path: Path) -> None:
    """`[alarm] windows` may be ten thousand: a page that holds older scores than the newest hundred counts as well."""
    filled(path, *scores(5000))
    with closing(sqlite3.connect(path)) as db:
        (size,), (count,) = (db.execute(f"PRAGMA {name}").fetchone() for name in ("page_size", "page_count"))
    with path.open("r+b") as file:
        file.seek(count // 2 * size)
        file.write(b"\xff" * size)
    filled(path, FULL)
    assert len([*path.parent.glob("history.db.damaged-*")]) == 1


def test_damage_found_while_writing_is_told_and_moved_aside_on_closing(path: Path) -> None:
    """Pages that go bad under an open store: ``damage`` says so, and closing moves the file aside and writes what waits
    into a new one."""
    filled(path, *scores(5000))
    store = Store(path, "arm1")
    with closing(sqlite3.connect(path)) as db:
        db.execute("PRAGMA writable_schema = ON")
        root = db.execute("SELECT rootpage FROM sqlite_schema WHERE name = 'score'").fetchone()[0]
        size = db.execute("PRAGMA page_size").fetchone()[0]
    with path.open("r+b") as file:
        file.seek((root - 1) * size)
        file.write(b"\xff" * size)
    store.add(*scores(3))
    wait_until(lambda: "is damaged" in store.problem)
    assert store.damage is not None
    assert store.close() == 0
    assert len([*path.parent.glob("history.db.damaged-*")]) == 1
    with open_readonly(path) as reader:
        assert reader.scores("elbow") == scores(3)


@pytest.mark.skipif(os.geteuid() != 0, reason="needs to give up root's rights to write everywhere")
def test_a_database_that_may_only_be_read_is_told(path: Path) -> None:
    """A user without the right to write gets one line, and can still read."""
    filled(path, FULL)
    for folder in [*path.parents][:-2]:
        folder.chmod(folder.stat().st_mode | 0o055)
    path.chmod(0o444)
    with another_user():
        with pytest.raises(StoreError, match="expected to be writable"):
            Store(path, "arm1")
        with open_readonly(path) as reader:
            assert reader.scores("elbow") == [FULL]


def test_two_services_do_not_share_a_database(path: Path) -> None:
    """The second Store of a path is refused while the first is open, and only then; nothing of the first is lost."""
    with closing(Store(path, "arm1")) as store:
        with pytest.raises(StoreError, match="another lostmotion service writes it"):
            Store(path, "arm2")
        store.add(FULL)
    with closing(Store(path, "arm1")), open_readonly(path) as reader:
        assert reader.scores("elbow") == [FULL]


def test_a_new_configuration_renames_the_robot_in_an_open_database(
    path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """What SIGHUP may change in the store is taken with the next row; the first name is there at once.  Another name
    than the one that was there is told once."""
    with closing(Store(path, "arm1")) as store:
        with store.reader() as reader:
            assert reader.robot() == "arm1"
        store.configure("arm2", 1.0, 0.0)
        store.add(FULL)
    with open_readonly(path) as reader:
        assert reader.robot() == "arm2"
    told = (
        f"{path}: found the history of robot {{}}, which {{}} continues; a robot of its own needs a store.path of its"
    )
    told += " own"
    assert caplog.messages == [told.format("arm1", "arm2")]
    with closing(Store(path, "arm2")), closing(open_readonly(path)) as reader:
        assert reader.robot() == "arm2"
    assert len(caplog.messages) == 1
    Store(path, "arm3").close()
    assert caplog.messages[1:] == [told.format("arm2", "arm3")]


def test_a_folder_that_cannot_be_made_is_told(tmp_path: Path) -> None:
    """A file where a folder should be, and a folder where the file should be."""
    (tmp_path / "file").touch()
    with pytest.raises(StoreError, match="the folder cannot be made"):
        Store(tmp_path / "file" / "history.db", "arm1")
    with pytest.raises(StoreError, match="found a folder, expected a file"):
        Store(tmp_path, "arm1")
    with pytest.raises(ReaderError, match="no database there; start"):
        open_readonly(tmp_path / "nothing.db")
    with pytest.raises(ReaderError, match="found a folder, expected a database"):
        open_readonly(tmp_path)


def test_rows_wait_while_the_disk_is_full(path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """When the file cannot grow, rows stay in memory, it is said once, and all are there when it can again."""
    with closing(Store(path, "arm1")) as store:
        with files_up_to(40_000):
            for row in scores(5000):
                store.add(row)
            wait_until(lambda: store.problem)
            assert "disk" in store.problem
            assert store.waiting() == 5000
        wait_until(lambda: not store.waiting())
        assert store.problem == ""
    with open_readonly(path) as reader:
        assert [row.score for row in reader.scores("elbow")] == [float(k) for k in range(5000)]
    assert [record.levelno for record in caplog.records] == [logging.ERROR, logging.WARNING]


def test_a_disk_that_is_full_at_the_start(path: Path) -> None:
    """A new database and one that is there: the store takes rows, what can be read is read, and once there is room all
    is written."""
    with files_up_to(5000), closing(Store(path, "arm1", patient=True)) as store:
        assert not store.is_open
        assert "disk" in store.problem
        with store.reader() as reader:
            assert reader.joints() == []
        store.add(FULL)
        files_may_grow()
        wait_until(lambda: not store.waiting())
        assert (store.is_open, store.problem) == (True, "")
    with files_up_to(5000), closing(Store(path, "arm2", patient=True)) as store:
        assert not store.is_open
        with store.reader() as reader:
            assert (reader.robot(), reader.scores("elbow")) == ("arm1", [FULL])
        store.add(BARE)
        files_may_grow()
        wait_until(lambda: not store.waiting())
    with open_readonly(path) as reader:
        assert (reader.robot(), len(reader.scores("elbow"))) == ("arm2", 2)


@pytest.mark.parametrize("files", [1, 2, 3])
def test_a_disk_without_room_for_a_file(small_disk: SmallDisk, files: int) -> None:
    """Where no folder, no lock or no database can be made, a patient store takes rows, says so, and writes and locks
    once there is room; any other names the cause."""
    path = small_disk.path / "state" / "history.db"
    small_disk.hold(files)
    with pytest.raises(StoreError, match=f"^{path}: the disk is full; free some space"):
        Store(path, "arm1")
    with closing(Store(path, "arm1", patient=True)) as store:
        assert (store.is_open, "the disk is full" in store.problem) == (False, True)
        with store.reader() as reader:
            assert reader.joints() == []
        store.add(FULL)
        small_disk.hold(1000)
        wait_until(lambda: not store.waiting())
        assert (store.is_open, store.problem, database.is_held(path)) == (True, "", True)
    assert not database.is_held(path)
    with open_readonly(path) as reader:
        assert reader.scores("elbow") == [FULL]


def test_rows_that_never_reached_a_disk_are_counted(path: Path) -> None:
    """Closing a store that could not even open its file tells how many rows are lost."""
    with files_up_to(5000):
        store = Store(path, "arm1", patient=True)
        store.add(*scores(3))
        assert store.close() == 3


def test_the_backlog_is_bounded(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Beyond its limit the oldest rows are given up and counted; raw windows have a limit of their own."""
    monkeypatch.setattr(storing, "BACKLOG_ROWS", 100)
    monkeypatch.setattr(storing, "BACKLOG_WINDOWS", 10)
    with closing(Store(path, "arm1")) as store:
        with files_up_to(20_000):
            for k, row in enumerate(scores(150)):
                store.add(raw_window(k, True, 2500))
                store.add(row)
            wait_until(lambda: store.problem)
            assert store.waiting() == 110
            assert store.dropped == 50 + 140
        wait_until(lambda: not store.waiting())
    with open_readonly(path) as reader:
        assert [row.score for row in reader.scores("elbow")] == [float(k) for k in range(50, 150)]


def test_a_database_that_is_locked_at_the_start(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A patient store begins all the same, and writes when the other program has let go."""
    monkeypatch.setattr(database, "BUSY_S", 0.05)
    filled(path)
    with closing(sqlite3.connect(path)) as other:
        other.execute("BEGIN IMMEDIATE")
        with pytest.raises(StoreError, match="another program holds the database locked; close it"):
            Store(path, "arm1")
        with closing(Store(path, "arm1", patient=True)) as store:
            assert "another program holds the database locked" in store.problem
            store.add(FULL)
            other.rollback()
            wait_until(lambda: not store.waiting())


def test_rows_wait_while_another_program_holds_the_lock(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A locked database is a problem that passes."""
    monkeypatch.setattr(database, "BUSY_S", 0.05)
    with closing(Store(path, "arm1")) as store, closing(sqlite3.connect(path)) as other:
        other.execute("BEGIN IMMEDIATE")
        store.add(FULL)
        wait_until(lambda: "another program holds the database locked" in store.problem)
        other.rollback()
        wait_until(lambda: not store.waiting())
    with open_readonly(path) as reader:
        assert reader.scores("elbow") == [FULL]


@contextmanager
def another_user() -> Iterator[None]:
    """Runs as nobody."""
    os.seteuid(65534)
    try:
        yield
    finally:
        os.seteuid(0)
