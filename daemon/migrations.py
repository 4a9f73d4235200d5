"""The database's schema, as the steps that led to it.  A step that has been released never changes; add one below.

Base tables are compact (whole microseconds, joint numbers, NULL for the usual) and may change; the views ``joints``,
``scores``, ``alarms``, ``alarm_events``, ``windows`` and ``devices`` are what third parties read and stay.
"""

from __future__ import annotations

__all__ = ["ADDED", "AS_ALARM", "CURRENT", "MIGRATIONS"]


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

# The life of alarms after ISA-18.2: a severity may change within an alarm, every transition is kept, and other
# processes ask for what only the service may do.
_ALARM = """
    joint_id INTEGER NOT NULL REFERENCES joint(id), cause TEXT NOT NULL, severity TEXT NOT NULL, state TEXT NOT NULL,
    raised_us INTEGER NOT NULL, acknowledged_us INTEGER, cleared_us INTEGER, shelved_until_us INTEGER,
    told_us INTEGER NOT NULL, reminders INTEGER NOT NULL, reason TEXT NOT NULL"""
# An alarm of schema 1 and 2 as one of the third; readers of a database that has not been migrated yet ask so, too.
_NEW_FORM = """id, joint_id, cause, severity,
    iif(cleared_us IS NOT NULL, 'normal', iif(acknowledged_us IS NULL, 'active', 'acknowledged')) AS state,
    raised_us, acknowledged_us, cleared_us, NULL AS shelved_until_us, raised_us AS told_us, 0 AS reminders, reason"""
AS_ALARM = f"SELECT {_NEW_FORM} FROM alarm"
THIRD = f"""
DROP VIEW alarms;
ALTER TABLE alarm RENAME TO old_alarm;
CREATE TABLE alarm (id INTEGER PRIMARY KEY, {_ALARM}, UNIQUE (joint_id, cause, raised_us));
INSERT OR REPLACE INTO alarm SELECT {_NEW_FORM} FROM old_alarm ORDER BY id;
DROP TABLE old_alarm;
CREATE INDEX alarm_that_lives ON alarm (joint_id) WHERE state != 'normal';
CREATE TABLE alarm_event (
    id INTEGER PRIMARY KEY, uid TEXT NOT NULL UNIQUE, event TEXT NOT NULL, time_us INTEGER NOT NULL,
    person TEXT NOT NULL, {_ALARM});
CREATE INDEX alarm_event_by_joint ON alarm_event (joint_id);
CREATE TABLE request (
    id INTEGER PRIMARY KEY, made_us INTEGER NOT NULL, joint TEXT NOT NULL, verb TEXT NOT NULL, cause TEXT,
    for_s REAL NOT NULL, person TEXT NOT NULL, done INTEGER, answer TEXT);
CREATE INDEX request_that_waits ON request (id) WHERE answer IS NULL;
CREATE VIEW alarms AS SELECT joint.name AS joint, severity, state, {_iso("raised_us")} AS raised,
    {_iso("acknowledged_us")} AS acknowledged, {_iso("cleared_us")} AS cleared, alarm.reason AS reason, cause,
    {_iso("shelved_until_us")} AS shelved_until FROM alarm JOIN joint ON joint.id = alarm.joint_id;
CREATE VIEW alarm_events AS SELECT uid AS id, {_iso("time_us")} AS time, joint.name AS joint, cause, event, severity,
    state, {_iso("raised_us")} AS raised, alarm_event.reason AS reason, person
    FROM alarm_event JOIN joint ON joint.id = alarm_event.joint_id;
"""

# The severity of each window, and both statistics of the detector beside the one that is the score.
ADDED = ("severity", "severity_low", "severity_high", "band", "ringdown")
FOURTH = f"""
{" ".join(f"ALTER TABLE score ADD COLUMN {name} REAL;" for name in ADDED)}
DROP VIEW scores;
CREATE VIEW scores AS SELECT joint.name AS joint, {_iso("time_us")} AS time, score, level, impact,
    play, play_low, play_high, severity, severity_low, severity_high, excitation, temperature,
    coalesce(quality, 'ok') AS quality, duration_us / 1e6 AS duration, band, ringdown
    FROM score JOIN joint ON joint.id = score.joint_id;
"""

# The commanded motion before each kept window: float32, first all times from its begin [s], then all angles [rad].
FIFTH = f"""
ALTER TABLE window ADD COLUMN command BLOB;
DROP VIEW windows;
CREATE VIEW windows AS SELECT joint.name AS joint, {_iso("time_us")} AS time, impact, rate_hz, offset, accel, command
    FROM window JOIN joint ON joint.id = window.joint_id;
"""

MIGRATIONS = (FIRST, SECOND, THIRD, FOURTH, FIFTH)
CURRENT = len(MIGRATIONS)
"""the schema version this program writes (PRAGMA user_version)"""
