"""What is written into the database: one thread does it, in batches.

Callers hand in rows and never wait for the disk.  When the disk refuses (full, locked), rows wait in a bounded backlog
and the store says so in ``problem``; raw windows are given up first.  Opening the file is in ``database.py``, reading
in ``reader.py``, the schema in ``migrations.py``, the reasons in docs/decisions/0004-store.md.
"""

from __future__ import annotations

import logging
import math
import sqlite3
import threading
import time
from collections import deque
from collections.abc import Sequence
from datetime import datetime
from pathlib import Path

from lostmotion.daemon import database
from lostmotion.daemon.database import StoreError
from lostmotion.daemon.reader import Reader, open_readonly
from lostmotion.daemon.records import Answer, DeviceRow, JointRow, ScoreRow, Transition, WindowRow, micros
from lostmotion.daemon.rollup import DAY_US, roll_up

__all__ = ["Reader", "Store", "open_readonly"]

log = logging.getLogger(__name__)

Row = ScoreRow | WindowRow | Transition | JointRow | DeviceRow | Answer
FLUSH_S = 0.15
"""how long the first row of a batch waits for company [s]; a transition of an alarm does not wait"""
RETRY_S = 1.0
"""pause after the disk refused [s]"""
BATCH = 5000
"""rows in one transaction at most"""
ROLL_UP_S = 0.005
"""how long old scores are rolled up after each batch [s]"""
BACKLOG_ROWS = 200_000
BACKLOG_WINDOWS = 2_000
ALARM = (
    "joint_id, cause, severity, state, raised_us, acknowledged_us, cleared_us, shelved_until_us, told_us, reminders,"
    " reason"
)


class Store:
    """The database of one robot, open for writing.  Raises StoreError when it cannot be opened.

    ``problem`` is "" while rows reach the disk, else what keeps them from it; ``dropped`` counts rows given up because
    the backlog was full; ``damage`` is what is wrong with the file itself: closing moves it aside.  While it is open no
    other process gets a Store of the same path: the scores of two robots would be mixed.
    """

    def __init__(self, path: Path, robot: str, keep_windows_mb: float = 100.0, keep_scores_days: float = 0.0) -> None:
        self.path = path
        self.problem = ""
        self.dropped = 0
        self.damage: sqlite3.Error | None = None
        self._keep_us = self._keep_bytes = self._kept_bytes = 0
        self._robot = self._robot_written = ""
        self.configure(robot, keep_windows_mb, keep_scores_days)
        self._newest: dict[int, int] = {}
        self._joints: dict[str, int] = {}
        self._rows: deque[Row] = deque()
        self._windows: deque[Row] = deque()
        self._in_flight = 0
        self._untold: deque[Transition] = deque()
        self._settled: deque[Transition] = deque()
        self._wake = threading.Condition()
        self._closing = False
        self._lock = database.lock(path)
        try:
            self._db = database.open_database(path)
            self._begin(robot)
        except StoreError:
            self._lock.close()
            raise
        self._thread = threading.Thread(target=self._run, name="store", daemon=True)
        self._thread.start()

    def _begin(self, robot: str) -> None:
        """Reads what the writer has to know.  Raises StoreError; a damaged file is moved aside first."""
        try:
            with self._db:
                self._write([])
            self._robot_written = robot
            self._joints = dict(self._db.execute("SELECT name, id FROM joint"))
            self._kept_bytes = self._db.execute("SELECT coalesce(sum(bytes), 0) FROM window").fetchone()[0]
        except sqlite3.Error as error:
            self._db.close()
            if not database.is_damage(error):
                raise StoreError(database.explain(self.path, error)) from error
            database.move_aside(self.path, error)
            self._db = database.open_database(self.path)
            self._begin(robot)

    def configure(self, robot: str, keep_windows_mb: float, keep_scores_days: float) -> None:
        """Sets what a new configuration may change.

        ``keep_windows_mb`` of raw windows stay [MB]; scores that are older than a joint's newest by
        ``keep_scores_days`` become one an hour, 0: never.
        """
        self._keep_us = int(keep_scores_days * DAY_US)
        self._keep_bytes = int(keep_windows_mb * 1e6)
        self._robot = robot

    def add(self, *rows: Row) -> None:
        """Takes rows, which are committed together within about ``FLUSH_S``.  Never blocks on the disk."""
        with self._wake:
            is_first = not (self._rows or self._windows)
            for row in rows:
                queue = self._windows if isinstance(row, WindowRow) else self._rows
                queue.append(row)
                if isinstance(row, Transition):
                    self._untold.append(row)
            self._trim()
            if is_first or self._untold:  # all others wait for FLUSH_S anyway
                self._wake.notify_all()

    def settled(self, wait_s: float = 0.0) -> list[Transition]:
        """The transitions that are on the disk, or that it has refused, in order, each once: now they may be told.

        One that was told before it was stored would be forgotten by a kill, and told again under another name.  Waits
        at most ``wait_s`` for those that are on their way.
        """
        with self._wake:
            self._wake.wait_for(lambda: not self._untold, wait_s)
            return [self._settled.popleft() for _ in range(len(self._settled))]

    @property
    def is_settling(self) -> bool:
        """Whether a transition is on its way to the disk, or waits to be told."""
        return bool(self._untold or self._settled)

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
            if self.damage is not None:
                database.move_aside(self.path, self.damage)
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
            elif not closing:
                self._roll_up()

    def _roll_up(self) -> None:
        """Goes on making old scores fewer, for a few milliseconds: alarms wait for this thread."""
        end = time.monotonic() + ROLL_UP_S
        try:
            with self._db:
                for joint, newest in self._newest.items() if self._keep_us else ():
                    while time.monotonic() < end and roll_up(self._db, joint, newest - self._keep_us):
                        pass
        except sqlite3.Error as error:
            # A disk that is full will refuse the next rows too, which are told of and tried again.
            self.damage = error if database.is_damage(error) else None

    def _flush(self, queue: deque[Row]) -> bool:
        """Commits the oldest rows of a queue; on failure they go back to its head."""
        with self._wake:
            batch = [queue.popleft() for _ in range(min(len(queue), BATCH))]
            self._in_flight = len(batch)
        if not batch and self._robot == self._robot_written:
            return True
        kept_bytes, problem = self._kept_bytes, ""
        try:
            with self._db:
                self._write(batch)
            self._robot_written = self._robot
        except sqlite3.Error as error:
            problem = database.explain(self.path, error)
            self.damage = error if database.is_damage(error) else None
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
        joint, time_us = self._id(row.joint), micros(row.time)
        self._newest[joint] = max(time_us, self._newest.get(joint, 0))
        return (
            joint, time_us, round(row.duration * 1e6), _null(row.score), row.level, row.impact,
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


def _micros(time: datetime | None) -> int | None:
    return None if time is None else micros(time)


def _marks(values: Sequence[object]) -> str:
    return ", ".join("?" * len(values))


def _null(value: float) -> float | None:
    return value if math.isfinite(value) else None
