"""The database's schema, as the steps that led to it.  A step that has been released never changes; add one below.

Base tables are compact (whole microseconds, joint numbers, NULL for the usual) and may change; the views ``joints``,
``scores``, ``alarms``, ``windows`` and ``devices`` are what third parties read and stay.
"""

from __future__ import annotations

__all__ = ["CURRENT", "MIGRATIONS"]


def _iso(column: str) -> str:
    """SQL for whole microseconds since 1970 as ISO 8601 UTC text."""
    return f"strftime('%Y-%m-%dT%H:%M:%S', {column} / 1000000, 'unixepoch') || printf('.%06dZ', {column} % 1000000)"


FIRST = f"""
CREATE TABLE meta (key TEXT PRIMARY KEY, value TEXT NOT NULL) WITHOUT ROWID;
CREATE TABLE joint (
    id INTEGER PRIMARY KEY, name TEXT NOT NULL UNIQUE,
    health TEXT NOT NULL DEFAULT 'OK', reason TEXT NOT NULL DEFAULT '', since_us INTEGER NOT NULL DEFAULT 0);
CREATE TABLE score (
    joint_id INTEGER NOT NULL REFERENCES joint(id), time_us INTEGER NOT NULL, duration_us INTEGER NOT NULL,
    score REAL, level REAL NOT NULL, impact INTEGER NOT NULL, play REAL, play_low REAL, play_high REAL,
    excitation REAL, temperature REAL, quality TEXT,
    PRIMARY KEY (joint_id, time_us)) WITHOUT ROWID;
CREATE TABLE alarm (
    id INTEGER PRIMARY KEY, joint_id INTEGER NOT NULL REFERENCES joint(id), cause TEXT NOT NULL,
    severity TEXT NOT NULL, raised_us INTEGER NOT NULL, acknowledged_us INTEGER, cleared_us INTEGER,
    reason TEXT NOT NULL, UNIQUE (joint_id, cause, severity, raised_us));
CREATE TABLE window (
    id INTEGER PRIMARY KEY, joint_id INTEGER NOT NULL REFERENCES joint(id), time_us INTEGER NOT NULL,
    impact INTEGER NOT NULL, bytes INTEGER NOT NULL, rate_hz REAL NOT NULL, offset REAL NOT NULL, accel BLOB NOT NULL,
    UNIQUE (joint_id, time_us));
CREATE INDEX window_by_worth ON window (impact, time_us, bytes);
CREATE VIEW joints AS SELECT name, health, reason, {_iso("since_us")} AS since FROM joint;
CREATE VIEW scores AS SELECT joint.name AS joint, {_iso("time_us")} AS time, score, level, impact,
    play, play_low, play_high, excitation, temperature, coalesce(quality, 'ok') AS quality,
    duration_us / 1e6 AS duration FROM score JOIN joint ON joint.id = score.joint_id;
CREATE VIEW alarms AS SELECT joint.name AS joint, severity, iif(cleared_us IS NULL, 'active', 'cleared') AS state,
    {_iso("raised_us")} AS raised, {_iso("acknowledged_us")} AS acknowledged, {_iso("cleared_us")} AS cleared,
    alarm.reason AS reason, cause FROM alarm JOIN joint ON joint.id = alarm.joint_id;
CREATE VIEW windows AS SELECT joint.name AS joint, {_iso("time_us")} AS time, impact, rate_hz, offset, accel
    FROM window JOIN joint ON joint.id = window.joint_id;
"""

# What the devices delivered and lost, so that a reader in another process can show it.
SECOND = f"""
CREATE TABLE device (
    name TEXT PRIMARY KEY, time_us INTEGER NOT NULL, state TEXT NOT NULL, reason TEXT NOT NULL,
    samples INTEGER NOT NULL, lost INTEGER NOT NULL, late INTEGER NOT NULL, broken INTEGER NOT NULL,
    silent INTEGER NOT NULL, overwritten INTEGER NOT NULL) WITHOUT ROWID;
CREATE VIEW devices AS SELECT name, {_iso("time_us")} AS time, state, reason, samples, lost, late, broken, silent,
    overwritten FROM device;
"""

MIGRATIONS = (FIRST, SECOND)
CURRENT = len(MIGRATIONS)
"""the schema version this program writes (PRAGMA user_version)"""
