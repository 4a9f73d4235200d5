"""What the service reports, as rows of the database and messages of the sinks.

Times are UTC, units SI, NaN is unknown.  Nothing here reads a clock.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from enum import Enum

import msgspec
import numpy as np
from numpy.typing import NDArray

from lostmotion.detector.window import Score, Window

__all__ = [
    "EPOCH",
    "AlarmEvent",
    "AlarmRow",
    "AlarmState",
    "Answer",
    "Cause",
    "DeviceRow",
    "Health",
    "JointRow",
    "Origin",
    "Origins",
    "Request",
    "ScoreRow",
    "Severity",
    "SinkRow",
    "SinkRows",
    "Task",
    "Transition",
    "Verb",
    "WindowRow",
    "from_micros",
    "iso",
    "micros",
]


EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
SURE = 0.95
"""a joint with this probability has play, one with the rest has none"""


class Health(Enum):
    """The health of a joint, from good to bad."""

    OK = "OK"
    DEGRADED = "DEGRADED"
    WARNING = "WARNING"
    ERROR = "ERROR"


class Severity(Enum):
    """How bad an alarm is, from mild to bad."""

    DEGRADED = "degraded"
    WARNING = "warning"
    ERROR = "error"


class Cause(Enum):
    """What an alarm is about: play, or a device that does not measure."""

    PLAY = "play"
    DEVICE = "device"


class AlarmState(Enum):
    """The state of an alarm (ISA-18.2); ``lifecycle.py`` has the transitions."""

    NORMAL = "normal"
    ACTIVE = "active"  # its cause is present, not acknowledged
    ACKNOWLEDGED = "acknowledged"  # its cause is present, acknowledged
    RETURNED = "returned"  # its cause has gone, not acknowledged
    SHELVED = "shelved"  # silent until a time, whatever its cause does


class AlarmEvent(Enum):
    """What happens to an alarm."""

    RAISED = "raised"
    ESCALATED = "escalated"
    EASED = "eased"
    CHANGED = "changed"  # another reason
    CLEARED = "cleared"
    ACKNOWLEDGED = "acknowledged"
    SHELVED = "shelved"
    UNSHELVED = "unshelved"  # its cause still stands
    LAPSED = "lapsed"  # unshelved, and its cause has gone meanwhile
    REMINDED = "reminded"


class ScoreRow(msgspec.Struct, frozen=True, gc=False):
    """One scored window; the fields are those of ``detector.window.Score``, time is UTC.

    No dataclass: a month of them is asked for, and that takes ten times as long to make.
    """

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
    severity: float = math.nan
    severity_low: float = math.nan
    severity_high: float = math.nan
    band: float = math.nan
    ringdown: float = math.nan

    @classmethod
    def of(cls, score: Score, time: datetime) -> ScoreRow:
        """The row of a score whose window began at ``time``."""
        return cls(
            score.joint, time, score.duration, score.score, score.level, score.impact, score.play, score.play_low,
            score.play_high, score.excitation, score.temperature, score.quality, score.severity, score.severity_low,
            score.severity_high, score.band, score.ringdown,
        )  # fmt: skip


@dataclass(frozen=True, slots=True)
class WindowRow:
    """The raw samples of a window: tip acceleration [m/s²], shape (N,), sample k at time + offset + k / rate_hz, NaN
    where one is missing; float32 is finer than any sensor it holds.  command: times from the window's begin [s] and the
    commanded angles [rad] before and in it, shape (2, M)."""

    joint: str
    time: datetime
    impact: bool
    rate_hz: float
    offset: float
    accel: NDArray[np.float32]
    command: NDArray[np.float32] = field(default_factory=lambda: np.empty((2, 0), np.float32))

    @classmethod
    def of(cls, window: Window, impact: bool, time: datetime, commands: NDArray[np.float64]) -> WindowRow:
        """The row of a window that began at ``time``; commands: robot times [s] and angles [rad], shape (2, M)."""
        offset = float(window.time[0]) - window.start
        command = (commands - np.array([[window.start], [0.0]])).astype(np.float32)
        return cls(window.joint, time, impact, window.rate_hz, offset, window.accel.astype(np.float32), command)


@dataclass(frozen=True, slots=True)
class AlarmRow:
    """One alarm from its first raising until it is normal again; None for what has not happened.

    cleared: when its cause went away; notified: when it was last raised or reminded of; reminders: their number.
    Joint, cause and raised identify it.
    """

    joint: str
    cause: Cause
    severity: Severity
    raised: datetime
    reason: str
    acknowledged: datetime | None = None
    cleared: datetime | None = None
    state: AlarmState = AlarmState.ACTIVE
    shelved_until: datetime | None = None
    notified: datetime = EPOCH
    reminders: int = 0

    @property
    def is_active(self) -> bool:
        """Whether it counts: its cause is present and it is not shelved."""
        return self.state in (AlarmState.ACTIVE, AlarmState.ACKNOWLEDGED)


@dataclass(frozen=True, slots=True)
class Transition:
    """What happened to an alarm, and the alarm after it; by: who did it, "" for the service itself."""

    event: AlarmEvent
    time: datetime
    alarm: AlarmRow
    by: str = ""

    @property
    def id(self) -> str:
        """The same for the same transition wherever and however often it is published; unique in the robot."""
        return f"{self.alarm.joint}/{self.alarm.cause.value}/{micros(self.time)}/{self.event.value}"


class Verb(Enum):
    """Requests of people about alarms."""

    ACK = "ack"
    SHELVE = "shelve"
    UNSHELVE = "unshelve"


class Task(Enum):
    """Requests of programs to a running service: a recording of a joint, to read its configuration again."""

    RECORD = "record"
    RELOAD = "reload"


@dataclass(frozen=True, slots=True)
class Request:
    """A request about the alarms of a joint, or to the service; cause None means all of them; for_s: how long to
    shelve, or to record [s]."""

    id: int
    joint: str
    verb: Verb | Task
    cause: Cause | None = None
    for_s: float = 0.0
    by: str = ""
    made: datetime = EPOCH


@dataclass(frozen=True, slots=True)
class Answer:
    """The answer to the request with this number; done: whether anything changed."""

    id: int
    done: bool
    text: str


@dataclass(frozen=True, slots=True)
class JointRow:
    """A joint's health since ``since``, and why."""

    name: str
    health: Health = Health.OK
    reason: str = ""
    since: datetime = EPOCH


@dataclass(frozen=True, slots=True)
class Origin:
    """Joints that share accelerometers, and the probability that each of them has play, after so many windows."""

    probabilities: Mapping[str, float]
    windows: int

    def spares(self, joint: str) -> bool:
        """Whether others are named, so that the play that this joint's windows show is taken for theirs."""
        return not self.is_open and self.probabilities[joint] < SURE

    @property
    def is_open(self) -> bool:
        """Whether no joint is named yet."""
        return max(self.probabilities.values()) < SURE

    def __str__(self) -> str:
        guilty = [f"{joint} ({_percent(p)})" for joint, p in self.probabilities.items() if p >= SURE]
        if guilty:
            return f"most probably of {' and '.join(guilty)}"
        names = list(self.probabilities)
        if max(self.probabilities.values()) <= 1 - SURE:
            return f"most probably of none of {', '.join(names)}"
        return f"of {', '.join(names[:-1])} or {names[-1]}: not identified yet"


@dataclass(frozen=True, slots=True)
class Origins:
    """Which joints the play comes from, for all groups that share accelerometers."""

    groups: tuple[Origin, ...]


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


@dataclass(frozen=True, slots=True)
class SinkRow:
    """A sink: whether it reaches what is behind it, None where it does not tell, and since when; error: why not, or
    the last reason since the start, "" for none."""

    name: str
    is_up: bool | None
    since: datetime
    error: str


@dataclass(frozen=True, slots=True)
class SinkRows:
    """All sinks of the configuration."""

    rows: tuple[SinkRow, ...]


def _percent(probability: float) -> str:
    return f"{probability:.0%}" if probability < 0.995 else "over 99%"


def iso(time: datetime) -> str:
    """UTC as ISO 8601 text with microseconds and ``Z``."""
    return f"{time.astimezone(UTC).isoformat(timespec='microseconds')[:-6]}Z"


def micros(time: datetime) -> int:
    """Whole microseconds since 1970."""
    return (time - EPOCH) // timedelta(microseconds=1)


def from_micros(count: int) -> datetime:
    """The UTC of whole microseconds since 1970."""
    return EPOCH + timedelta(0, 0, count)
