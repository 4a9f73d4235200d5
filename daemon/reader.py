"""Queries of the database, in another process than the one that writes it."""

from __future__ import annotations

import errno
import json
import os
import sqlite3
import stat
from collections.abc import Iterator, Mapping, Sequence
from datetime import datetime, timedelta
from pathlib import Path
from types import TracebackType
from typing import Any

import msgspec
import numpy as np

from lostmotion.daemon.database import CACHE_KB, UNREADABLE, is_damage, newer
from lostmotion.daemon.extremes import extremes_of
from lostmotion.daemon.learnt import FlankRow, NoiseRow
from lostmotion.daemon.migrations import ADDED, AS_ALARM, CURRENT, MIGRATIONS
from lostmotion.daemon.records import (
    AlarmRow,
    Answer,
    Cause,
    DeviceRow,
    Health,
    JointRow,
    Origin,
    Request,
    ScoreRow,
    SinkRow,
    Task,
    Transition,
    Verb,
    WindowRow,
    from_micros,
    micros,
)
from lostmotion.daemon.rollup import SERIES, Series, hourly
from lostmotion.daemon.rows import SCORE, alarm_of, nan_of, score_of, time_of, transition_of
from lostmotion.daemon.timekeeper import ClockRow
from lostmotion.drivers.errors import LostmotionError

__all__ = ["NOISE", "Bounds", "Reader", "ReaderError", "empty_reader", "open_readonly"]


OLD_SCORES = f"CREATE TEMP VIEW score AS SELECT *, {', '.join(f'NULL AS {name}' for name in ADDED)} FROM main.score"
"""what a database before version 4 lacks is unknown"""
NUMBERS = (
    "time_us, score, level, impact, quality IS NULL, ifnull(play, 9e999), ifnull(excitation, 9e999),"
    " ifnull(temperature, 9e999), ifnull(severity, 9e999)"
)
"""the columns of a series, in the order of its fields"""
WINDOW_OF = " WHERE joint_id = (SELECT id FROM joint WHERE name = ?)"
BATCH = 5000
Bounds = tuple[datetime | None, datetime | None, int | None]
"""since, until, and how many of the newest; None: no bound"""
FOREIGN = "does it belong to the service's user? then use sudo"
NOISE = "noise/"
"""begin of the keys of ``meta`` under which noises are kept, by joint"""
FLANK = "flank/"
"""likewise of those under which laws of the flanks are kept"""


class ReaderError(LostmotionError):
    """There is no database to read, or none that this program understands."""


def open_readonly(path: Path) -> Reader:
    """Opens a database that a service may be writing.  Raises ReaderError."""
    if refusal := _refusal(path):
        raise ReaderError(f"{path}: {refusal}")
    try:
        db, version = _connect(path, "mode=ro")
    except UNREADABLE as error:
        advice = "is it a database of lostmotion?"
        if is_damage(error) and getattr(error, "sqlite_errorname", "") != "SQLITE_NOTADB":
            advice = "it is damaged: `lostmotion run` moves it aside, and sqlite3's .recover may save most of it"
        raise ReaderError(f"{path}: cannot be read ({error}); {advice}") from error
    if not 0 < version <= CURRENT:
        db.close()
        if not path.stat().st_size:
            raise ReaderError(f"{path}: is empty; has no service been able to write it (a full disk)?")
        other = (
            f"{path}: found schema version {version}, expected 1 to {CURRENT}; likely it is no database of lostmotion"
        )
        raise ReaderError(newer(path, version) if version > CURRENT else other)
    return Reader(db)


def _refusal(path: Path) -> str:
    """Why no database can be read there, "" where one may be.  The file is not opened: that would release the locks of
    this program's other readers."""
    try:
        mode = path.stat().st_mode
    except (FileNotFoundError, NotADirectoryError):
        mode = 0
    except OSError as error:
        return f"cannot be read: {error.strerror}; {FOREIGN}"
    if stat.S_ISDIR(mode):
        return "found a folder, expected a database, such as history.db in it"
    if not stat.S_ISREG(mode):
        here = "" if path.is_absolute() else ", in the working folder"
        return f"no database there{here}; start `lostmotion run` first, or name its configuration"
    if not os.access(path, os.R_OK, effective_ids=True):
        return f"cannot be read: {os.strerror(errno.EACCES)}; {FOREIGN}"
    return ""


def empty_reader() -> Reader:
    """A database without any rows, in memory."""
    db = sqlite3.connect(":memory:")
    db.executescript(f"{''.join(MIGRATIONS)} PRAGMA user_version = {CURRENT};")
    return Reader(db)


def _connect(path: Path, mode: str) -> tuple[sqlite3.Connection, int]:
    """The open database and the version of its schema."""
    db = sqlite3.connect(f"{path.absolute().as_uri()}?{mode}", uri=True, timeout=5.0)
    try:
        version = int(db.execute("PRAGMA user_version").fetchone()[0])
        db.execute("SELECT count(*) FROM sqlite_schema").fetchone()
        db.execute(f"PRAGMA cache_size = -{CACHE_KB}")
    except UNREADABLE:
        db.close()
        # Where this user may not write, or the disk is full, SQLite cannot make the files that readers share with a
        # writer; none is needed while nobody writes.
        wal = Path(f"{path}-wal")
        if mode == "mode=ro" and not (wal.exists() and wal.stat().st_size):
            return _connect(path, "immutable=1")
        raise
    return db, version


class Reader:
    """An open database; a context manager."""

    OF = (
        "FROM score WHERE joint_id = (SELECT id FROM joint WHERE name = :joint)"
        " AND time_us >= :since AND time_us < :until"
    )
    SCORES = f"SELECT {SCORE} {OF} ORDER BY time_us DESC LIMIT :limit"

    def __init__(self, connection: sqlite3.Connection) -> None:
        self._db = connection
        self._version: int = connection.execute("PRAGMA user_version").fetchone()[0]
        if self._version < 4:
            connection.execute("PRAGMA temp_store = MEMORY")  # the file itself may be read-only
            connection.execute(OLD_SCORES)

    def __enter__(self) -> Reader:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Closes the database."""
        self._db.close()

    def robot(self) -> str:
        """The robot's name."""
        return str(next((row["value"] for row in self._rows("SELECT value FROM meta WHERE key = 'robot'")), ""))

    def clock(self) -> ClockRow | None:
        """The time as the service last wrote it."""
        value = next((row["value"] for row in self._rows("SELECT value FROM meta WHERE key = 'clock'")), None)
        return None if value is None else ClockRow(*map(int, json.loads(value)))

    def newest(self) -> datetime | None:
        """The latest stamp of any score."""
        (row,) = self._rows(
            "SELECT max((SELECT max(time_us) FROM score WHERE joint_id = joint.id)) AS time_us FROM joint"
        )
        return time_of(row["time_us"])

    def origins(self) -> list[Origin]:
        """Where play comes from, for each group of joints that share accelerometers, as the service last wrote it."""
        groups = next((row["value"] for row in self._rows("SELECT value FROM meta WHERE key = 'origins'")), "[]")
        return [Origin(probabilities, windows) for probabilities, windows in json.loads(groups)]

    def sinks(self) -> list[SinkRow]:
        """The sinks and their states, as the service last wrote them."""
        rows = next((row["value"] for row in self._rows("SELECT value FROM meta WHERE key = 'sinks'")), "[]")
        return [SinkRow(name, is_up, from_micros(since), error) for name, is_up, since, error in json.loads(rows)]

    def noises(self) -> list[NoiseRow]:
        """The noise of each joint's windows, as far as the service has learnt it."""
        rows = self._rows(f"SELECT value FROM meta WHERE key GLOB '{NOISE}*' ORDER BY key")
        return [msgspec.json.decode(row["value"], type=NoiseRow) for row in rows]

    def flanks(self) -> list[FlankRow]:
        """The elasticity of each joint's tooth flanks, as far as the service has learnt it."""
        rows = self._rows(f"SELECT value FROM meta WHERE key GLOB '{FLANK}*' ORDER BY key")
        return [msgspec.json.decode(row["value"], type=FlankRow) for row in rows]

    def joints(self) -> list[JointRow]:
        """All joints ever seen and their health, by name."""
        rows = self._rows("SELECT name, health, reason, since_us FROM joint ORDER BY name")
        return [
            JointRow(row["name"], Health(row["health"]), row["reason"], from_micros(row["since_us"])) for row in rows
        ]

    def scores(
        self, joint: str, since: datetime | None = None, until: datetime | None = None, limit: int | None = None
    ) -> list[ScoreRow]:
        """Scores of a joint with since <= time < until, oldest first; with a limit, the newest so many of them."""
        rows = self._db.execute(self.SCORES, _bounds(joint, since, until, limit)).fetchall()
        return [score_of(joint, row) for row in reversed(rows)]

    def batches(self, joint: str, bounds: Bounds, size: int = BATCH) -> Iterator[list[tuple[Any, ...]]]:
        """The same rows as the database has them (SCORE), oldest first, so many at a time: each batch is a question of
        its own, so that no writer has to keep old pages for a slow reader."""
        found = _bounds(joint, *bounds) | {"size": size}
        newest = f"SELECT min(time_us), max(time_us) FROM (SELECT time_us {self.OF} ORDER BY time_us DESC LIMIT :limit)"
        first, last = self._db.execute(newest, found).fetchone()
        if first is None:
            return
        found |= {"since": first, "until": last + 1}  # what is added meanwhile is not waited for
        query = f"SELECT {SCORE} {self.OF} ORDER BY time_us LIMIT :size"
        while batch := self._db.execute(query, found).fetchall():
            yield batch
            found["since"] = batch[-1][0] + 1

    def stream(self, joint: str, bounds: Bounds) -> Iterator[list[ScoreRow]]:
        """What ``scores`` would return, a few thousand at a time."""
        for batch in self.batches(joint, bounds):
            yield [score_of(joint, row) for row in batch]

    def largest(self, joint: str, bounds: Bounds) -> float:
        """The largest finite score within the bounds; NaN without any."""
        query = (
            f"SELECT max(score) FROM (SELECT score {self.OF} ORDER BY time_us DESC LIMIT :limit) WHERE score < 9e999"
        )
        return nan_of(self._db.execute(query, _bounds(joint, *bounds)).fetchone()[0])

    def series(
        self, joint: str, since: datetime | None = None, until: datetime | None = None, most: int | None = None
    ) -> Series:
        """The scores that are numbers, as columns; where there are more than ``most``, one an hour, as old ones are
        kept."""
        bounds = _bounds(joint, since, until, -1 if most is None else most + 1)
        rows = f"{self.OF} AND score IS NOT NULL"
        count = self._db.execute(f"SELECT count(*) FROM (SELECT 1 {rows} LIMIT :limit)", bounds).fetchone()[0]
        if most is None or count <= most:
            return np.fromiter(self._db.execute(f"SELECT {NUMBERS} {rows} ORDER BY time_us", bounds), SERIES)
        (number,) = self._db.execute("SELECT id FROM joint WHERE name = ?", [joint]).fetchone()
        chosen = hourly(self._db, NUMBERS, number, bounds["since"], bounds["until"])
        return np.fromiter((row for row in chosen if row[1] is not None), SERIES)

    def last_window(self, joint: str) -> ScoreRow | None:
        """The newest scored window of a joint."""
        rows = self.scores(joint, limit=1)
        return rows[0] if rows else None

    def alarms(self, joint: str | None = None, *, living: bool = False) -> list[AlarmRow]:
        """Alarms of one joint or of all, oldest first; living: only those that are not normal again."""
        table = "alarm" if self._version >= 3 else f"({AS_ALARM}) AS alarm"
        rows = self._rows(
            f"SELECT alarm.*, joint.name AS joint FROM {table} JOIN joint ON joint.id = joint_id"
            " WHERE (:joint IS NULL OR joint.name = :joint) AND (NOT :living OR state != 'normal')"
            " ORDER BY raised_us, alarm.id",
            {"joint": joint, "living": living},
        )
        return [alarm_of(row) for row in rows]

    def active_alarms(self, joint: str | None = None) -> list[AlarmRow]:
        """Alarms whose cause is present and that are not shelved, oldest first."""
        return [alarm for alarm in self.alarms(joint, living=True) if alarm.is_active]

    def transitions(
        self, joint: str | None = None, cause: Cause | None = None, *, after: int = 0, newest: int = -1
    ) -> list[tuple[int, Transition]]:
        """What happened to alarms, oldest first, each with its number in this database.

        after: only those with a larger number; newest: only so many of them.
        """
        if self._version < 3:
            return []
        rows = self._rows(
            "SELECT alarm_event.*, joint.name AS joint FROM alarm_event JOIN joint ON joint.id = joint_id"
            " WHERE (:joint IS NULL OR joint.name = :joint) AND (:cause IS NULL OR cause = :cause)"
            " AND alarm_event.id > :after ORDER BY alarm_event.id DESC LIMIT :newest",
            {"joint": joint, "cause": cause and cause.value, "after": after, "newest": newest},
        )
        return [(row["id"], transition_of(row)) for row in reversed(rows)]

    def requests(self, after: int = 0) -> list[Request]:
        """Requests about alarms that are not answered yet, oldest first; after: only those with a larger
        number."""
        return self._asked(Verb, after)

    def tasks(self) -> list[Request]:
        """The same for requests to the service."""
        return self._asked(Task)

    def _asked(self, kind: type[Verb] | type[Task], after: int = 0) -> list[Request]:
        if self._version < 3:
            return []
        known = ", ".join(f"'{verb.value}'" for verb in kind)
        rows = self._rows(
            f"SELECT * FROM request WHERE answer IS NULL AND id > ? AND verb IN ({known}) ORDER BY id", [after]
        )
        return [
            Request(
                row["id"], row["joint"], kind(row["verb"]), Cause(row["cause"]) if row["cause"] else None,
                row["for_s"], row["person"], from_micros(row["made_us"]),
            )
            for row in rows
        ]  # fmt: skip

    def answer(self, request: int) -> Answer | None:
        """The answer to a request; None while there is none."""
        rows = self._rows("SELECT * FROM request WHERE id = ? AND answer IS NOT NULL", [request])
        return next((Answer(request, bool(row["done"]), row["answer"]) for row in rows), None)

    def sampled(self, joint: str, since: datetime, until: datetime, count: int) -> list[ScoreRow]:
        """At most ``count`` sound scores, the first of as many equal spans of time, oldest first: quick however many
        there are."""
        query = (
            f"SELECT {SCORE} FROM score WHERE joint_id = (SELECT id FROM joint WHERE name = ?) AND time_us >= ?"
            " AND time_us < ? AND quality IS NULL AND score IS NOT NULL ORDER BY time_us LIMIT 1"
        )
        step = (until - since) / count
        spans = ((micros(since + k * step), micros(since + (k + 1) * step)) for k in range(count))
        return [score_of(joint, row) for span in spans for row in self._db.execute(query, [joint, *span])]

    def revision(self) -> int:
        """A number that changes when another connection has committed anything (SQLite's ``data_version``)."""
        return int(self._db.execute("PRAGMA data_version").fetchone()[0])

    def extremes(self, joint: str, since: datetime, until: datetime, pieces: int) -> list[tuple[Any, ...]]:
        """What a plot of any number of scores needs: the time is divided into ``pieces``, and each that holds scores
        gives one row in time order with the columns of EXTREMES, the medians being those of its first windows.  NULL
        for a piece without such a value."""
        return extremes_of(self._db, self.OF, _bounds(joint, since, until, None), pieces)

    def extent(self, joint: str) -> tuple[datetime, datetime] | None:
        """The times of a joint's first and last scores; None without any."""
        query = f"SELECT (SELECT min(time_us) {self.OF}), (SELECT max(time_us) {self.OF})"
        first, last = self._db.execute(query, _bounds(joint, None, None, None)).fetchone()
        return None if first is None else (from_micros(first), from_micros(last))

    def window_times(self, joint: str, since: datetime, until: datetime, most: int) -> list[tuple[datetime, bool]]:
        """Times of the raw windows that are kept, with whether each is an impact's; at most so many, evenly chosen."""
        query = "SELECT time_us, impact FROM window" + WINDOW_OF + " AND time_us >= ? AND time_us < ? ORDER BY time_us"
        rows = self._db.execute(query, [joint, micros(since), micros(until)]).fetchall()
        chosen = rows[:: max(-(-len(rows) // most), 1)]
        return [(from_micros(time), bool(impact)) for time, impact in chosen]

    def window(self, joint: str, time: datetime) -> WindowRow | None:
        """The kept raw window whose begin is nearest to a time; None where none is kept."""
        command = "command" if self._version >= 5 else "NULL"
        query = f"SELECT time_us, impact, rate_hz, offset, accel, {command} FROM window{WINDOW_OF}"
        near = [micros(time)]
        before = self._db.execute(f"{query} AND time_us <= ? ORDER BY time_us DESC LIMIT 1", [joint, *near]).fetchall()
        after = self._db.execute(f"{query} AND time_us > ? ORDER BY time_us LIMIT 1", [joint, *near]).fetchall()
        found = min(before + after, key=lambda row: abs(row[0] - near[0]), default=None)
        if found is None:
            return None
        accel, commands = np.frombuffer(found[4], "<f4"), np.frombuffer(found[5] or b"", "<f4").reshape(2, -1)
        return WindowRow(joint, from_micros(found[0]), bool(found[1]), found[2], found[3], accel, commands)

    def score_at(self, joint: str, time: datetime) -> ScoreRow | None:
        """The score of the window that began at this very time."""
        rows = self.scores(joint, time, time + timedelta(microseconds=1))
        return rows[0] if rows else None

    def devices(self) -> list[DeviceRow]:
        """What each servo bus and accelerometer has delivered and lost, as the service last wrote it."""
        if self._version < 2:
            return []
        rows = self._rows("SELECT * FROM device ORDER BY name")
        return [DeviceRow(time=from_micros(row.pop("time_us")), **row) for row in rows]

    def _rows(self, query: str, parameters: Sequence[object] | Mapping[str, object] = ()) -> list[dict[str, Any]]:
        """The rows of a short answer, by the names of their columns."""
        cursor = self._db.execute(query, parameters)
        names = [column[0] for column in cursor.description]
        return [dict(zip(names, row, strict=True)) for row in cursor]


def _bounds(joint: str, since: datetime | None, until: datetime | None, limit: int | None) -> dict[str, Any]:
    return {
        "joint": joint,
        "since": micros(since) if since else 0,
        "until": micros(until) if until else 2**62,
        "limit": -1 if limit is None else limit,
    }
