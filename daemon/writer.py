"""Rows as SQL: how they get into the tables, and which old ones go.  Queues, threads and retries: ``store.py``."""

from __future__ import annotations

import json
import logging
import math
import sqlite3
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from datetime import datetime, timedelta
from pathlib import Path

import msgspec

from lostmotion.daemon import database
from lostmotion.daemon.learnt import FlankRow, NoiseRow
from lostmotion.daemon.reader import FLANK, NOISE, Reader
from lostmotion.daemon.records import (
    Answer,
    Cause,
    DeviceRow,
    JointRow,
    Origins,
    ScoreRow,
    SinkRows,
    Transition,
    WindowRow,
    micros,
)
from lostmotion.daemon.rollup import HOUR_US, roll_up
from lostmotion.daemon.timekeeper import DOUBTFUL, ClockRow, Mend

__all__ = ["Policy", "Row", "Writer"]

log = logging.getLogger(__name__)

NEWEST, LOOKED_AT = 100, 10_000
"""so many scores and transitions of each joint have to make sense at the start; so many scores' pages to be sound: a
service may go on from as many"""
LOOK = (
    "SELECT total(score) FROM (SELECT score FROM score WHERE joint_id = (SELECT id FROM joint WHERE name = ?)"
    " ORDER BY time_us DESC LIMIT ?)"
)
Row = (
    ScoreRow
    | WindowRow
    | Transition
    | JointRow
    | DeviceRow
    | SinkRows
    | Origins
    | NoiseRow
    | FlankRow
    | Answer
    | ClockRow
    | Mend
)
ALARM = (
    "joint_id, cause, severity, state, raised_us, acknowledged_us, cleared_us, shelved_until_us, told_us, reminders,"
    " reason"
)


@dataclass(frozen=True, slots=True)
class Policy:
    """The options of the database: the robot's name, how many bytes of raw windows stay, and after how
    many microseconds a joint's scores become one an hour, 0: never."""

    robot: str
    windows_bytes: int
    scores_us: int


class Writer:
    """A database open for writing, by one thread at a time; a damaged one is moved aside for a new one.

    Raises StoreError when it cannot be opened; its methods raise UNREADABLE and leave nothing half written.
    """

    def __init__(self, path: Path, policy: Policy) -> None:
        self._path = path
        self.damage = ""
        """What was wrong with the file that was at the path and had to be moved aside, "" for nothing."""
        self._begin(path, policy)

    def _begin(self, path: Path, policy: Policy) -> None:
        """Opens the file and shows that it can be written and read.  A new one in the place of one that is damaged
        begins with what the latter knows of alarms that are not over."""
        self._robot = ""
        self._newest: dict[int, int] = {}
        self._joints: dict[str, int] = {}
        self._rolled: dict[int, int] = {}
        self._kept_bytes = 0
        self._bound_us = math.inf
        self._db = database.open_database(path)
        try:
            self.commit([], policy)
            self._kept_bytes = self._db.execute("SELECT coalesce(sum(bytes), 0) FROM window").fetchone()[0]
            _read_newest(self._db)
            self._db.execute("PRAGMA shrink_memory")  # a page in memory would hide damage that comes later
        except database.DAMAGED as error:
            known = _living(self._db)
            self.close()
            if not database.is_damage(error):
                raise database.refusal(path, error) from error
            database.move_aside(path, error)
            self._begin(path, policy)
            self.commit(known, policy)
            self.damage = database.explain(path, error)

    def close(self) -> None:
        """Gives the file back."""
        self._db.close()

    def commit(self, rows: Sequence[Row], policy: Policy) -> None:
        """Writes rows in one transaction."""
        kept_bytes, other = self._kept_bytes, ""
        try:
            with self._db:
                if policy.robot != self._robot:
                    other = self._named(policy.robot)
                self._write(rows, policy)
        except (*database.UNREADABLE, MemoryError):
            self._joints, self._kept_bytes = {}, kept_bytes
            raise
        self._robot = policy.robot
        if other:
            log.warning(
                "%s: found the history of robot %s, which %s continues; a robot of its own needs a store.path of its "
                "own", self._path, other, policy.robot,
            )  # fmt: skip

    def roll_up(self, policy: Policy, seconds: float) -> None:
        """Goes on making old scores fewer, for so long."""
        end = time.monotonic() + seconds
        for joint, newest in self._newest.items() if policy.scores_us else ():
            old_us = round(min(newest, self._bound_us)) - policy.scores_us
            if self._rolled.get(joint) == old_us // HOUR_US:
                continue  # nothing more until another hour is old
            with self._db:
                while time.monotonic() < end:
                    if not roll_up(self._db, joint, old_us):
                        self._rolled[joint] = old_us // HOUR_US
                        break

    def _named(self, robot: str) -> str:
        """Writes the robot's name; returns that of another one whose history this was, "" for none."""
        before = self._db.execute("SELECT value FROM meta WHERE key = 'robot'").fetchone()
        self._db.execute("INSERT OR REPLACE INTO meta VALUES ('robot', ?)", [robot])
        return str(before[0]) if before and before[0] != robot else ""

    def _write(self, rows: Sequence[Row], policy: Policy) -> None:
        scores = [self._score(row) for row in rows if isinstance(row, ScoreRow)]
        if scores:
            self._db.executemany(f"INSERT OR REPLACE INTO score VALUES ({_marks(scores[0])})", scores)
        for row in rows:
            match row:
                case WindowRow():
                    self._window(row, policy.windows_bytes)
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
                case Mend():
                    self._mend(row)
                case ClockRow() | NoiseRow() | FlankRow() | Origins() | SinkRows():
                    self._meta(row)

    def _meta(self, row: ClockRow | NoiseRow | FlankRow | Origins | SinkRows) -> None:
        """Writes what has one row in the table of names and values."""
        match row:
            case ClockRow():
                self._bound_us = row.bound_us
                entry = ["clock", json.dumps([row.known_us, row.bound_us])]
            case NoiseRow():
                entry = [f"{NOISE}{row.joint}", msgspec.json.encode(row).decode()]
            case FlankRow():
                entry = [f"{FLANK}{row.joint}", msgspec.json.encode(row).decode()]
            case Origins():
                entry = ["origins", json.dumps([[dict(one.probabilities), one.windows] for one in row.groups])]
            case SinkRows():
                sinks = [[one.name, one.is_up, micros(one.since), one.error] for one in row.rows]
                entry = ["sinks", json.dumps(sinks)]
        self._db.execute("INSERT OR REPLACE INTO meta VALUES (?, ?)", entry)

    def _mend(self, row: Mend) -> None:
        """Moves what was stamped by a wrong clock."""
        span = {"since": micros(row.since), "until": micros(row.until), "shift": row.shift // timedelta(microseconds=1)}
        unmarked = f"nullif(trim(replace(quality, '{DOUBTFUL}', ''), ','), '')"
        where = "WHERE time_us BETWEEN :since AND :until"
        self._db.execute(f"UPDATE OR REPLACE score SET time_us = time_us + :shift, quality = {unmarked} {where}", span)
        self._db.execute(f"UPDATE OR REPLACE window SET time_us = time_us + :shift {where}", span)
        self._newest = {joint: min(newest, micros(row.until + row.shift)) for joint, newest in self._newest.items()}

    def _id(self, joint: str) -> int:
        if joint not in self._joints:
            self._db.execute("INSERT OR IGNORE INTO joint (name) VALUES (?)", [joint])
            self._joints[joint] = self._db.execute("SELECT id FROM joint WHERE name = ?", [joint]).fetchone()[0]
        return self._joints[joint]

    def _score(self, row: ScoreRow) -> tuple[object, ...]:
        numbers = (row.play, row.play_low, row.play_high, row.excitation, row.temperature)
        added = (row.severity, row.severity_low, row.severity_high, row.band, row.ringdown)
        joint, time_us = self._id(row.joint), micros(row.time)
        self._newest[joint] = max(time_us, self._newest.get(joint, 0))
        return (
            joint, time_us, round(row.duration * 1e6), _null(row.score), row.level, row.impact,
            *map(_null, numbers), None if row.quality == "ok" else row.quality, *map(_null, added),
        )  # fmt: skip

    def _transition(self, row: Transition) -> None:
        """The alarm as it is now, and what happened; what is there already stays (a recording replayed twice)."""
        alarm = row.alarm
        values = [
            self._id(alarm.joint), alarm.cause.value, alarm.severity.value, alarm.state.value,
            micros(alarm.raised), *map(_micros, (alarm.acknowledged, alarm.cleared, alarm.shelved_until)),
            micros(alarm.notified), alarm.reminders, alarm.reason,
        ]  # fmt: skip
        known = [row.id, row.event.value, micros(row.time), row.by]
        self._db.execute(f"INSERT OR REPLACE INTO alarm ({ALARM}) VALUES ({_marks(values)})", values)
        self._db.execute(
            f"INSERT OR IGNORE INTO alarm_event (uid, event, time_us, person, {ALARM})"
            f" VALUES ({_marks([*known, *values])})",
            [*known, *values],
        )

    def _window(self, row: WindowRow, limit: int) -> None:
        accel, command = row.accel.astype("<f4").tobytes(), row.command.astype("<f4").tobytes()
        size = len(accel) + len(command)
        self._db.execute(
            "INSERT OR REPLACE INTO window (joint_id, time_us, impact, bytes, rate_hz, offset, accel, command)"
            " VALUES (?, ?, ?, ?, ?, ?, ?, ?)",
            [self._id(row.joint), micros(row.time), row.impact, size, row.rate_hz, row.offset, accel, command],
        )
        self._kept_bytes += size
        if self._kept_bytes > limit:
            self._make_room(0.95 * limit)

    def _make_room(self, goal: float) -> None:
        """Drops the oldest windows, those without an impact first, until only so many bytes are left."""
        gone = []
        for number, size in self._db.execute("SELECT id, bytes FROM window ORDER BY impact, time_us"):
            if self._kept_bytes <= goal:
                break
            self._kept_bytes -= size
            gone.append((number,))
        self._db.executemany("DELETE FROM window WHERE id = ?", gone)


def _living(db: sqlite3.Connection) -> list[Row]:
    """The last transition of each alarm that is not over, and the health of these joints, as far as they can be read of
    a damaged database."""
    found: list[Row] = []
    reader = Reader(db)
    with suppress(*database.DAMAGED):
        alarms = reader.alarms(living=True)
        alarmed = {alarm.joint for alarm in alarms}
        found += [joint for joint in reader.joints() if joint.name in alarmed]
        for alarm in alarms:
            found += [one for _, one in reader.transitions(alarm.joint, alarm.cause, newest=1)]
    return found


def _read_newest(db: sqlite3.Connection) -> None:
    """Reads what a service goes on from; raises one of DAMAGED where a page or a value of it is bad."""
    reader = Reader(db)
    for read in (
        reader.devices,
        reader.requests,
        reader.alarms,
        reader.origins,
        reader.sinks,
        reader.noises,
        reader.flanks,
    ):
        read()
    for joint in reader.joints():
        reader.scores(joint.name, limit=NEWEST)
        db.execute(LOOK, [joint.name, LOOKED_AT]).fetchone()
        for cause in Cause:
            reader.transitions(joint.name, cause, newest=NEWEST)


def _micros(time: datetime | None) -> int | None:
    return None if time is None else micros(time)


def _marks(values: Sequence[object]) -> str:
    return ", ".join("?" * len(values))


def _null(value: float) -> float | None:
    return value if math.isfinite(value) else None
