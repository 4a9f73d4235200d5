"""Questions to the database, in another process than the one that writes it."""

from __future__ import annotations

import math
import sqlite3
from datetime import datetime
from pathlib import Path
from types import TracebackType
from typing import Any

from lostmotion.daemon.migrations import CURRENT
from lostmotion.daemon.records import (
    AlarmRow,
    Cause,
    DeviceRow,
    Health,
    JointRow,
    ScoreRow,
    Severity,
    from_micros,
    micros,
)
from lostmotion.drivers.errors import LostmotionError

__all__ = ["Reader", "ReaderError", "open_readonly"]


class ReaderError(LostmotionError):
    """There is no database to read, or none that this program understands."""


def open_readonly(path: Path) -> Reader:
    """Opens a database that a service may be writing.  Raises ReaderError."""
    if not path.is_file():
        raise ReaderError(f"{path}: no database there; start `lostmotion run` first, or name its configuration")
    try:
        db, version = _connect(path, "mode=ro")
    except sqlite3.Error as error:
        raise ReaderError(f"{path}: cannot be read ({error}); is it a database of lostmotion?") from error
    if not 0 < version <= CURRENT:
        db.close()
        newer = "a newer lostmotion wrote it" if version > CURRENT else "it is no database of lostmotion"
        raise ReaderError(f"{path}: found schema version {version}, expected 1 to {CURRENT}; likely {newer}")
    return Reader(db)


def _connect(path: Path, mode: str) -> tuple[sqlite3.Connection, int]:
    """The open database and the version of its schema."""
    db = sqlite3.connect(f"{path.absolute().as_uri()}?{mode}", uri=True, timeout=5.0)
    try:
        version = int(db.execute("PRAGMA user_version").fetchone()[0])
        db.execute("SELECT count(*) FROM sqlite_schema").fetchone()
    except sqlite3.Error:
        db.close()
        # Where this user may not write, SQLite cannot make the files that readers share with a writer; none is needed
        # while nobody writes.
        if mode == "mode=ro" and not Path(f"{path}-wal").exists():
            return _connect(path, "immutable=1")
        raise
    return db, version


class Reader:
    """An open database; a context manager."""

    SCORES = (
        "SELECT time_us, duration_us, score, level, impact, play, play_low, play_high, excitation, temperature, quality"
        " FROM score WHERE joint_id = ? AND time_us >= ? AND time_us < ? ORDER BY time_us DESC LIMIT ?"
    )

    def __init__(self, db: sqlite3.Connection) -> None:
        self._db = db
        self._version: int = db.execute("PRAGMA user_version").fetchone()[0]

    def __enter__(self) -> Reader:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        self._db.close()

    def robot(self) -> str:
        """The robot's name."""
        row = self._db.execute("SELECT value FROM meta WHERE key = 'robot'").fetchone()
        return str(row[0]) if row else ""

    def joints(self) -> list[JointRow]:
        """All joints ever seen and their health, by name."""
        rows = self._db.execute("SELECT name, health, reason, since_us FROM joint ORDER BY name")
        return [JointRow(name, Health(health), reason, from_micros(since)) for name, health, reason, since in rows]

    def scores(
        self, joint: str, since: datetime | None = None, until: datetime | None = None, limit: int | None = None
    ) -> list[ScoreRow]:
        """Scores of a joint with since <= time < until, oldest first; with a limit, the newest so many of them."""
        number = self._db.execute("SELECT id FROM joint WHERE name = ?", [joint]).fetchone()
        if number is None:
            return []
        bounds = [micros(since) if since else 0, micros(until) if until else 2**62, -1 if limit is None else limit]
        rows = self._db.execute(self.SCORES, [number[0], *bounds]).fetchall()
        return [_score(joint, row) for row in reversed(rows)]

    def last_window(self, joint: str) -> ScoreRow | None:
        """The newest scored window of a joint."""
        rows = self.scores(joint, limit=1)
        return rows[0] if rows else None

    def alarms(self, joint: str | None = None, active_only: bool = False) -> list[AlarmRow]:
        """Alarms of one joint or of all, oldest first."""
        rows = self._db.execute(
            "SELECT name, cause, severity, raised_us, alarm.reason, acknowledged_us, cleared_us"
            " FROM alarm JOIN joint ON joint.id = joint_id WHERE (?1 IS NULL OR name = ?1)"
            " AND (NOT ?2 OR cleared_us IS NULL) ORDER BY raised_us, alarm.id",
            [joint, active_only],
        )
        return [
            AlarmRow(
                name,
                Cause(cause),
                Severity(severity),
                from_micros(raised),
                reason,
                _maybe(acknowledged),
                _maybe(cleared),
            )
            for name, cause, severity, raised, reason, acknowledged, cleared in rows
        ]

    def active_alarms(self, joint: str | None = None) -> list[AlarmRow]:
        """Alarms that have been raised and not cleared, oldest first."""
        return self.alarms(joint, active_only=True)

    def devices(self) -> list[DeviceRow]:
        """What each servo bus and accelerometer has delivered and lost, as the service last wrote it."""
        if self._version < 2:
            return []
        rows = self._db.execute(
            "SELECT name, time_us, state, reason, samples, lost, late, broken, silent, overwritten"
            " FROM device ORDER BY name"
        )
        return [DeviceRow(name, from_micros(time), *rest) for name, time, *rest in rows]


def _maybe(count: int | None) -> datetime | None:
    return None if count is None else from_micros(count)


def _score(joint: str, row: tuple[Any, ...]) -> ScoreRow:
    time, duration, score, level, impact, *numbers, quality = row
    score, play, low, high, excitation, temperature = (math.nan if x is None else x for x in (score, *numbers))
    return ScoreRow(
        joint, from_micros(time), duration / 1e6, score, level, bool(impact), play, low, high, excitation, temperature,
        quality or "ok",
    )  # fmt: skip
