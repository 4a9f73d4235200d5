"""The JSON documents that the command line prints and Zenoh answers with: one place for their keys."""

from __future__ import annotations

import math
from datetime import datetime
from typing import Any

import numpy as np

from lostmotion.daemon.learnt import FlankRow, NoiseRow
from lostmotion.daemon.reader import Reader
from lostmotion.daemon.records import (
    AlarmRow,
    JointRow,
    Origin,
    ScoreRow,
    SinkRow,
    Transition,
    from_micros,
    iso,
    micros,
)
from lostmotion.daemon.rollup import SERIES, Series

__all__ = ["SCORE_KEYS", "alarm", "attribution", "history", "joint", "learnt", "score", "series", "sinks",
           "status", "to_series",
           "transition"]  # fmt: skip

COLUMNS = tuple(name for name in SERIES.names or () if name != "time_us")
SCORE_KEYS = (
    "time", "score", "level", "impact", "play", "play_low", "play_high", "severity", "severity_low", "severity_high",
    "quality",
)  # fmt: skip


def alarm(row: AlarmRow) -> dict[str, Any]:
    """One alarm."""
    return {
        "joint": row.joint,
        "cause": row.cause.value,
        "severity": row.severity.value,
        "state": row.state.value,
        "raised": iso(row.raised),
        "acknowledged": _time(row.acknowledged),
        "cleared": _time(row.cleared),
        "shelved_until": _time(row.shelved_until),
        "reason": row.reason,
    }


def transition(row: Transition) -> dict[str, Any]:
    """What happened to an alarm; ``id`` is the same however often it is published."""
    return {"id": row.id, "event": row.event.value, "time": iso(row.time), "by": row.by} | alarm(row.alarm)


def joint(row: JointRow, last: ScoreRow | None, alarms: list[AlarmRow]) -> dict[str, Any]:
    """A joint as ``status`` shows it."""
    return {
        "name": row.name,
        "health": row.health.value,
        "score": last and last.score,
        "level": last and last.level,
        "play": last and last.play,
        "severity": last and last.severity,
        "last_window": last and iso(last.time),
        "alarms": [alarm(one) for one in alarms],
    }


def status(reader: Reader) -> dict[str, Any]:
    """All joints, their health and their active alarms; where joints share accelerometers, whose play it is."""
    joints = [joint(row, reader.last_window(row.name), reader.active_alarms(row.name)) for row in reader.joints()]
    return (
        {"robot": reader.robot(), "joints": joints}
        | sinks(reader.sinks())
        | attribution(reader.origins())
        | learnt(reader.noises(), reader.flanks())
    )


def sinks(rows: list[SinkRow]) -> dict[str, Any]:
    """Whether each sink reaches what is behind it; nothing without any."""
    found = [{"name": row.name, "up": row.is_up, "since": iso(row.since), "error": row.error} for row in rows]
    return {"sinks": found} if found else {}


def attribution(origins: list[Origin]) -> dict[str, Any]:
    """The probability that each joint has play, for each group that shares accelerometers; nothing without any."""
    groups = [{"joints": dict(origin.probabilities), "windows": origin.windows} for origin in origins]
    return {"attribution": groups} if groups else {}


def learnt(rows: list[NoiseRow], flanks: list[FlankRow]) -> dict[str, Any]:
    """The noise that each joint's windows are held against, the bar, and the elasticity of the teeth, where these have
    been learnt; nothing where they have not."""
    noises = [
        {
            "joint": row.joint,
            "noise_ms2": row.deviation if row.covariance else None,
            "windows": row.seen,
            "f_res_hz": row.bar.used_hz if row.bar else row.f_res_hz,
            "zeta": row.bar.used_zeta if row.bar else row.zeta,
            "changes": [{"time": iso(change.time), "text": change.text} for change in row.changes],
        }
        for row in rows
    ]
    teeth = [
        {"joint": row.joint, "softness": row.softness, "windows": row.windows, "servo_delay_s": row.delay}
        for row in flanks
    ]
    return ({"noise": noises} if noises else {}) | ({"flanks": teeth} if teeth else {})


def history(joint: str, scores: list[ScoreRow]) -> dict[str, Any]:
    """Scores of a joint."""
    return {"joint": joint, "scores": [score(row) for row in scores]}


def score(row: ScoreRow) -> dict[str, Any]:
    """One score."""
    return {key: iso(row.time) if key == "time" else getattr(row, key) for key in SCORE_KEYS}


def series(joint: str, columns: Series) -> dict[str, Any]:
    """What a trend is computed from, a list for each column."""
    lists = {name: [_known(value) for value in columns[name].tolist()] for name in COLUMNS}
    return {"joint": joint, "time": [iso(from_micros(time)) for time in columns["time_us"].tolist()]} | lists


def to_series(document: dict[str, Any]) -> Series:
    """The columns of such a document.  Raises ValueError, KeyError or TypeError for another one."""
    columns = np.empty(len(document["time"]), SERIES)
    columns["time_us"] = [micros(datetime.fromisoformat(time)) for time in document["time"]]
    for name in COLUMNS:
        columns[name] = [math.inf if value is None else value for value in document[name]]
    return columns


def _known(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _time(time: datetime | None) -> str | None:
    return None if time is None else iso(time)
