"""Rows of the database as the values that they were written from."""

from __future__ import annotations

import math
from datetime import datetime
from typing import Any

from lostmotion.daemon.migrations import ADDED
from lostmotion.daemon.records import (
    AlarmEvent,
    AlarmRow,
    AlarmState,
    Cause,
    ScoreRow,
    Severity,
    Transition,
    from_micros,
)

__all__ = ["SCORE", "alarm_of", "nan_of", "score_of", "time_of", "transition_of"]

SCORE = (
    "time_us, duration_us, score, level, impact, play, play_low, play_high, excitation, temperature, quality,"
    f" {', '.join(ADDED)}"
)
"""the columns of a score, in the order of ScoreRow's fields"""


def alarm_of(row: dict[str, Any]) -> AlarmRow:
    """An alarm; its columns, and the joint's name."""
    return AlarmRow(
        row["joint"],
        Cause(row["cause"]),
        Severity(row["severity"]),
        from_micros(row["raised_us"]),
        row["reason"],
        time_of(row["acknowledged_us"]),
        time_of(row["cleared_us"]),
        AlarmState(row["state"]),
        time_of(row["shelved_until_us"]),
        from_micros(row["told_us"]),
        row["reminders"],
    )


def transition_of(row: dict[str, Any]) -> Transition:
    """What happened to an alarm; the columns of the event, and the joint's name."""
    return Transition(AlarmEvent(row["event"]), from_micros(row["time_us"]), alarm_of(row), row["person"])


def score_of(joint: str, row: tuple[Any, ...]) -> ScoreRow:
    """A row of SCORE's columns, by place: there may be tens of thousands."""
    time_us, duration_us, score, level, impact, play, low, high, excitation, temperature, quality, *added = row
    return ScoreRow(
        joint, from_micros(time_us), duration_us / 1e6, nan_of(score), level, bool(impact), nan_of(play), nan_of(low),
        nan_of(high), nan_of(excitation), nan_of(temperature), quality or "ok", *map(nan_of, added),
    )  # fmt: skip


def nan_of(value: float | None) -> float:
    """NULL as NaN."""
    return math.nan if value is None else value


def time_of(count: int | None) -> datetime | None:
    """Microseconds since 1970 as a time."""
    return None if count is None else from_micros(count)
