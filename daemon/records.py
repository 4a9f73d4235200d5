"""What the service says to the world, as rows of the database and messages of the sinks.

Times are UTC, units SI, NaN is unknown.  Nothing here reads a clock.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from lostmotion.detector.window import Score, Window

__all__ = [
    "AlarmRow",
    "DeviceRow",
    "Health",
    "JointRow",
    "ScoreRow",
    "Severity",
    "WindowRow",
    "from_micros",
    "iso",
    "micros",
]


EPOCH = datetime(1970, 1, 1, tzinfo=UTC)


class Health(Enum):
    """The health of a joint, from good to bad."""

    OK = "OK"
    DEGRADED = "DEGRADED"
    WARNING = "WARNING"
    ERROR = "ERROR"


class Severity(Enum):
    """How bad an alarm is."""

    WARNING = "warning"
    ERROR = "error"


class Cause(Enum):
    """What an alarm is about: the play that is heard, or a device that should hear it."""

    PLAY = "play"
    DEVICE = "device"


@dataclass(frozen=True, slots=True)
class ScoreRow:
    """One scored window; the fields are those of ``detector.window.Score``, time is UTC."""

    joint: str
    time: datetime
    duration: float
    score: float
    level: float
    impact: bool
    play: float = math.nan
    play_low: float = math.nan
    play_high: float = math.nan
    excitation: float = math.nan
    temperature: float = math.nan
    quality: str = "ok"

    @classmethod
    def of(cls, score: Score, time: datetime) -> ScoreRow:
        """The row of a score whose window began at ``time``."""
        return cls(
            score.joint, time, score.duration, score.score, score.level, score.impact, score.play, score.play_low,
            score.play_high, score.excitation, score.temperature, score.quality,
        )  # fmt: skip


@dataclass(frozen=True, slots=True)
class WindowRow:
    """The raw samples of a window: tip acceleration [m/s²], shape (N,), sample k at time + offset + k / rate_hz, NaN
    where one is missing; float32 is finer than any sensor it holds."""

    joint: str
    time: datetime
    impact: bool
    rate_hz: float
    offset: float
    accel: NDArray[np.float32]

    @classmethod
    def of(cls, window: Window, impact: bool, time: datetime) -> WindowRow:
        """The row of a window that began at ``time``."""
        offset = float(window.time[0]) - window.start
        return cls(window.joint, time, impact, window.rate_hz, offset, window.accel.astype(np.float32))


@dataclass(frozen=True, slots=True)
class AlarmRow:
    """One alarm from its raising to its clearing; None for what has not happened.  state: active or cleared."""

    joint: str
    cause: Cause
    severity: Severity
    raised: datetime
    reason: str
    acknowledged: datetime | None = None
    cleared: datetime | None = None

    @property
    def state(self) -> str:
        return "active" if self.cleared is None else "cleared"


@dataclass(frozen=True, slots=True)
class JointRow:
    """A joint's health since ``since``, and why."""

    name: str
    health: Health = Health.OK
    reason: str = ""
    since: datetime = EPOCH


@dataclass(frozen=True, slots=True)
class DeviceRow:
    """What a servo bus or accelerometer has delivered since the service started, as of ``time``."""

    name: str
    time: datetime
    state: str
    reason: str
    samples: int
    lost: int
    late: int
    broken: int
    silent: int
    overwritten: int


def iso(time: datetime) -> str:
    """UTC as ISO 8601 text with microseconds and ``Z``."""
    return time.astimezone(UTC).strftime("%Y-%m-%dT%H:%M:%S.%fZ")


def micros(time: datetime) -> int:
    """Whole microseconds since 1970."""
    return (time - EPOCH) // timedelta(microseconds=1)


def from_micros(count: int) -> datetime:
    """The UTC of whole microseconds since 1970."""
    return EPOCH + timedelta(microseconds=count)
