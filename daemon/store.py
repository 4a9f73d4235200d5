"""The database: one thread that writes it, in batches; and opening it with clear errors.

Callers hand in rows and never wait for the disk.  When the disk refuses (full, locked), rows wait in a bounded backlog
and the store says so in ``problem``; raw windows are given up first.  Reading is in ``reader.py``, the schema in
``migrations.py``, the reasons in docs/decisions/0004-store.md.
"""

from __future__ import annotations

import fcntl
import logging
import math
import shutil
import sqlite3
import threading
from collections import deque
from collections.abc import Sequence
from datetime import datetime
from pathlib import Path
from typing import IO

from lostmotion.daemon.migrations import CURRENT, MIGRATIONS
from lostmotion.daemon.reader import Reader, open_readonly
from lostmotion.daemon.records import Answer, DeviceRow, JointRow, ScoreRow, Transition, WindowRow, micros
from lostmotion.drivers.errors import LostmotionError

__all__ = ["Reader", "Store", "StoreBusyError", "StoreError", "open_readonly"]

log = logging.getLogger(__name__)

Row = ScoreRow | WindowRow | Transition | JointRow | DeviceRow | Answer
FLUSH_S = 0.1
"""how long the first row of a batch waits for company [s]; a transition of an alarm does not wait"""
RETRY_S = 1.0
"""pause after the disk refused [s]"""
BATCH = 5000
"""rows in one transaction at most"""
BACKLOG_ROWS = 200_000
BACKLOG_WINDOWS = 2_000
ALARM = (
    "joint_id, cause, severity, state, raised_us, acknowledged_us, cleared_us, shelved_until_us, told_us, reminders,"
    " reason"
)
BUSY_S = 2.0
"""how long another program's lock is waited for [s]"""


class StoreError(LostmotionError):
    """The database cannot be used; the one-line message says why and what to do."""


class StoreBusyError(StoreError):
    """A service holds the database."""


class Store:
    """The database of one robot, open for writing.  Raises StoreError when it cannot be opened.

    ``problem`` is "" while rows reach the disk, else what keeps them from it; ``dropped`` counts rows given up because
    the backlog was full.  While it is open no other process gets a Store of the same path: the scores of two robots
    would be mixed.
    """

    def __init__(self, path: Path, robot: str, keep_windows_mb: float = 100.0) -> None:
        self.path = path
        self.problem = ""
        self.dropped = 0
        self._keep_bytes = self._kept_bytes = 0
        self._robot = self._robot_written = ""
        self.configure(robot, keep_windows_mb)
        self._joints: dict[str, int] = {}
        self._rows: deque[Row] = deque()
        self._windows: deque[Row] = deque()
        self._in_flight = 0
        self._untold: deque[Transition] = deque()
        self._settled: deque[Transition] = deque()
        self._wake = threading.Condition()
        self._closing = False
        self._lock = _lock(path)
        try:
            self._db = _open(path)
            with self._db:
                self._write([])
            self._robot_written = robot
            self._joints = dict(self._db.execute("SELECT name, id FROM joint"))
            self._kept_bytes = self._db.execute("SELECT coalesce(sum(bytes), 0) FROM window").fetchone()[0]
        except sqlite3.Error as error:
            self._db.close()
            self._lock.close()
            raise StoreError(_explain(path, error)) from error
        except StoreError:
            self._lock.close()
            raise
        self._thread = threading.Thread(target=self._run, name="store", daemon=True)
        self._thread.start()

    def configure(self, robot: str, keep_windows_mb: float) -> None:
        """Sets what a new configuration may change; ``keep_windows_mb`` of raw windows stay [MB]."""
        self._keep_bytes = int(keep_windows_mb * 1e6)
        self._robot = robot

    def add(self, *rows: Row) -> None:
        """Takes rows, which are committed together within about ``FLUSH_S``.  Never blocks on the disk."""
        with self._wake:
            for row in rows:
                queue = self._windows if isinstance(row, WindowRow) else self._rows
                queue.append(row)
                if isinstance(row, Transition):
                    self._untold.append(row)
            self._trim()
            self._wake.notify_all()

    def settled(self, wait_s: float = 0.0) -> list[Transition]:
        """The transitions that are on the disk, or that it has refused, in order, each once: now they may be told.

        One that was told before it was stored would be forgotten by a kill, and told again under another name.  Waits
        at most ``wait_s`` for those that are on their way.
        """
        with self._wake:
            self._wake.wait_for(lambda: not self._untold, wait_s)
            return [self._settled.popleft() for _ in range(len(self._settled))]

    def reader(self) -> Reader:
        """The same database for reading."""
        return open_readonly(self.path)

    def waiting(self) -> int:
        """How many rows are not on the disk yet."""
        with self._wake:
            return len(self._rows) + len(self._windows) + self._in_flight

    def close(self, timeout_s: float = 5.0) -> int:
        """Writes what is waiting, tries for at most ``timeout_s``, and closes the database.

        Returns how many rows were lost: not written now, or given up before.
        """
        with self._wake:
            self._closing = True
            self._wake.notify()
        self._thread.join(timeout_s)
        if not self._thread.is_alive():
            self._db.close()
        self._lock.close()
        lost = self.waiting() + self.dropped
        if lost:
            log.error("%s: %d rows were lost: %s", self.path, lost, self.problem or "the disk was too slow")
        return lost

    def _run(self) -> None:
        while True:
            with self._wake:
                self._wake.wait_for(lambda: self._rows or self._windows or self._closing)
                closing = self._closing
                if not closing:
                    self._wake.wait_for(lambda: self._closing or self._untold, FLUSH_S)
            if closing and not self.waiting():
                return
            if not (self._flush(self._rows) and self._flush(self._windows)):
                if closing:
                    return
                with self._wake:
                    self._wake.wait_for(lambda: self._closing, RETRY_S)

    def _flush(self, queue: deque[Row]) -> bool:
        """Commits the oldest rows of a queue; on failure they go back to its head."""
        with self._wake:
            batch = [queue.popleft() for _ in range(min(len(queue), BATCH))]
            self._in_flight = len(batch)
        kept_bytes, problem = self._kept_bytes, ""
        try:
            with self._db:
                self._write(batch)
            self._robot_written = self._robot
        except sqlite3.Error as error:
            problem = _explain(self.path, error)
            self._joints, self._kept_bytes = {}, kept_bytes
        with self._wake:
            self._in_flight = 0
            if problem:
                queue.extendleft(reversed(batch))
                self._trim()
            self._settle(list(self._untold) if problem else batch)
        if problem or batch:
            self._say(problem)
        return not problem

    def _settle(self, rows: Sequence[Row]) -> None:
        """These may be told, unless they were; the disk's refusal keeps no alarm from people."""
        for row in rows:
            if self._untold and self._untold[0] is row:
                self._settled.append(self._untold.popleft())
        self._wake.notify_all()

    def _trim(self) -> None:
        for queue, limit in ((self._rows, BACKLOG_ROWS), (self._windows, BACKLOG_WINDOWS)):
            while len(queue) > limit:
                self._settle([queue.popleft()])
                self.dropped += 1

    def _say(self, problem: str) -> None:
        if problem and not self.problem:
            log.error("%s; scoring goes on, rows wait in memory", problem)
        elif self.problem and not problem:
            log.warning("%s: written again; %d rows were given up meanwhile", self.path, self.dropped)
        self.problem = problem

    def _write(self, rows: Sequence[Row]) -> None:
        if self._robot != self._robot_written:
            self._db.execute("INSERT OR REPLACE INTO meta VALUES ('robot', ?)", [self._robot])
        scores = [self._score(row) for row in rows if isinstance(row, ScoreRow)]
        self._db.executemany("INSERT OR REPLACE INTO score VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)", scores)
        for row in rows:
            match row:
                case WindowRow():
                    self._window(row)
                case Transition():
                    self._transition(row)
                case Answer():
                    self._db.execute(
                        "UPDATE request SET done = ?, answer = ? WHERE id = ?", [row.done, row.text, row.id]
                    )
                case JointRow():
                    self._db.execute(
                        "UPDATE joint SET health = ?, reason = ?, since_us = ? WHERE id = ?",
                        [row.health.value, row.reason, micros(row.since), self._id(row.name)],
                    )
                case DeviceRow():
                    values = [row.name, micros(row.time), row.state, row.reason, row.samples, row.lost, row.late]
                    values += [row.broken, row.silent, row.overwritten]
                    self._db.execute("INSERT OR REPLACE INTO device VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?)", values)

    def _id(self, joint: str) -> int:
        if joint not in self._joints:
            self._db.execute("INSERT OR IGNORE INTO joint (name) VALUES (?)", [joint])
            self._joints[joint] = self._db.execute("SELECT id FROM joint WHERE name = ?", [joint]).fetchone()[0]
        return self._joints[joint]

    def _score(self, row: ScoreRow) -> tuple[object, ...]:
        numbers = (row.play, row.play_low, row.play_high, row.excitation, row.temperature)
        return (
            self._id(row.joint), micros(row.time), round(row.duration * 1e6), _null(row.score), row.level, row.impact,
            *map(_null, numbers), None if row.quality == "ok" else row.quality,
        )  # fmt: skip

    def _transition(self, row: Transition) -> None:
        """The alarm as it is now, and what happened; what is there already stays (a recording replayed twice)."""
        alarm = row.alarm
        values = [
            self._id(alarm.joint), alarm.cause.value, alarm.severity.value, alarm.state.value,
            micros(alarm.raised), *map(_micros, (alarm.acknowledged, alarm.cleared, alarm.shelved_until)),
            micros(alarm.told), alarm.reminders, alarm.reason,
        ]  # fmt: skip
        known = [row.id, row.event.value, micros(row.time), row.by]
        self._db.execute(f"INSERT OR REPLACE INTO alarm ({ALARM}) VALUES ({_marks(values)})", values)
        self._db.execute(
            f"INSERT OR IGNORE INTO alarm_event (uid, event, time_us, person, {ALARM})"
            f" VALUES ({_marks([*known, *values])})",
            [*known, *values],
        )

    def _window(self, row: WindowRow) -> None:
        accel = row.accel.astype("<f4").tobytes()
        self._db.execute(
            "INSERT OR REPLACE INTO window (joint_id, time_us, impact, bytes, rate_hz, offset, accel)"
            " VALUES (?, ?, ?, ?, ?, ?, ?)",
            [self._id(row.joint), micros(row.time), row.impact, len(accel), row.rate_hz, row.offset, accel],
        )
        self._kept_bytes += len(accel)
        if self._kept_bytes > self._keep_bytes:
            self._make_room()

    def _make_room(self) -> None:
        """Drops the oldest windows, those without an impact first, until a twentieth of the limit is free."""
        goal = 0.95 * self._keep_bytes
        gone = []
        for number, size in self._db.execute("SELECT id, bytes FROM window ORDER BY impact, time_us"):
            if self._kept_bytes <= goal:
                break
            self._kept_bytes -= size
            gone.append((number,))
        self._db.executemany("DELETE FROM window WHERE id = ?", gone)


def _lock(path: Path) -> IO[bytes]:
    """Holds ``path``.lock, in a folder that is made if need be, as long as the file is open."""
    if path.is_dir():
        raise StoreError(f"{path}: found a folder, expected a file; add its name to store.path")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise StoreError(f"{path}: the folder cannot be made: {error.strerror}; choose another store.path") from error
    try:
        file = path.with_name(f"{path.name}.lock").open("ab")
    except OSError as error:
        raise StoreError(
            f"{path}: its folder is found read-only, expected to be writable; check its owner ({error.strerror})"
        ) from error
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        file.close()
        raise StoreBusyError(
            f"{path}: another lostmotion service writes it, expected to be the only one; stop that one, or choose "
            "another store.path"
        ) from error
    return file


def _open(path: Path) -> sqlite3.Connection:
    """Opens the database for writing and brings its schema up to date."""
    db = None
    try:
        db = sqlite3.connect(path, timeout=BUSY_S, check_same_thread=False)
        db.execute("PRAGMA journal_mode = WAL")
        db.execute("PRAGMA synchronous = NORMAL")
        _migrate(db, path)
    except sqlite3.Error as error:
        if db is not None:
            db.close()
        raise StoreError(_explain(path, error)) from error
    return db


def _migrate(db: sqlite3.Connection, path: Path) -> None:
    version = db.execute("PRAGMA user_version").fetchone()[0]
    if version > CURRENT:
        raise StoreError(
            f"{path}: found schema version {version}, expected at most {CURRENT}; likely a newer lostmotion wrote it"
        )
    if version == 0 and db.execute("SELECT count(*) FROM sqlite_schema").fetchone()[0]:
        raise StoreError(f"{path}: is the database of another program; choose another store.path")
    if 0 < version < CURRENT:
        _backup(db, path, version)
    for number, script in enumerate(MIGRATIONS[version:], start=version + 1):
        db.executescript(f"BEGIN IMMEDIATE; {script} PRAGMA user_version = {number}; COMMIT;")


def _backup(db: sqlite3.Connection, path: Path, version: int) -> None:
    copy = path.with_name(f"{path.name}.version{version}")
    log.warning("%s: schema version %d becomes %d; a copy stays in %s", path, version, CURRENT, copy.name)
    if shutil.disk_usage(path.parent).free < 2 * path.stat().st_size:
        raise StoreError(
            f"{path}: no room for a copy before its schema changes; free {path.stat().st_size / 5e5:.0f} MB"
        )
    with sqlite3.connect(copy) as target:
        db.backup(target)
    target.close()


def _explain(path: Path, error: sqlite3.Error) -> str:
    """SQLite's error as one line for a person."""
    causes = {
        "SQLITE_FULL": "the disk is full; free some space",
        "SQLITE_BUSY": "another program holds the database locked; close it",
        "SQLITE_READONLY": "found read-only, expected to be writable; check the owner of the file and its folder",
        "SQLITE_CANTOPEN": "cannot be opened; check that the path is a file in a folder this user may write",
        "SQLITE_NOTADB": "is no SQLite database; move it away or choose another store.path",
        "SQLITE_CORRUPT": "is damaged; move it away, and try sqlite3's .recover on it",
        "SQLITE_IOERR": "the disk refuses to read or write (full, over quota, or failing)",
    }
    name = getattr(error, "sqlite_errorname", "")
    for code, cause in causes.items():
        if name.startswith(code):
            return f"{path}: {cause} ({error})"
    return f"{path}: {error}"


def _micros(time: datetime | None) -> int | None:
    return None if time is None else micros(time)


def _marks(values: Sequence[object]) -> str:
    return ", ".join("?" * len(values))


def _null(value: float) -> float | None:
    return value if math.isfinite(value) else None
