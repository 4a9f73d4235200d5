"""What every format looks like to the rest: named series of numbers over time.  No format is read here."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from typing import Any, Protocol

from lostmotion.drivers.base import FloatArray
from lostmotion.drivers.errors import RecordingError

__all__ = [
    "DATE",
    "MOST_SERIES",
    "MOST_VALUES",
    "Choice",
    "Part",
    "Samples",
    "Series",
    "Source",
    "Term",
    "check_count",
    "reason",
    "shown",
    "too_many",
]

MOST_SERIES = 10_000
"""in one file; a humanoid's log with every message type has some 3000"""
MOST_VALUES = 50_000_000
"""that are kept of one file, times included: 400 MB; ten columns at 1 kHz for an hour and more"""
DATE = "date"
"""the unit of a series of dates or times of day, which is a time whatever its name"""
LONGEST_NAME = 120
"""characters of a series, in messages"""

Part = tuple[FloatArray, FloatArray]
"""times [s] and values of a series, (N,) each"""


@dataclass(frozen=True, slots=True)
class Series:
    """One signal: its name, as people write it in ``--map``, and the unit of its values where the format has one."""

    name: str
    unit: str = ""


@dataclass(frozen=True, slots=True)
class Term:
    """The definition of a column: ``factor * series + offset``; an empty name leaves the column out.

    unit: in which that stands, "" for that in the series' name; factor None: that of the unit.
    """

    name: str
    unit: str = ""
    factor: float | None = None
    offset: float = 0.0


@dataclass(frozen=True, slots=True)
class Choice:
    """The options for a file.  terms: by column; topics: come first where several fit a column; rate_hz:
    where the file has no times; hint: the joint that is meant where the file has one of that name; base: of the
    lab's models, for which it is read."""

    terms: Mapping[str, Term] = field(default_factory=dict)
    joint: str = ""
    topics: Sequence[str] = ()
    episode: int | None = None
    rate_hz: float | None = None
    hint: str = ""
    base: str = ""

    @property
    def is_linear(self) -> bool:
        """Whether the motion that is meant is along a line, and no angle."""
        return self.base == "oscillator"

    def __bool__(self) -> bool:
        return bool(self.terms or self.joint or self.topics or self.rate_hz or self.episode is not None)


@dataclass(frozen=True, slots=True, eq=False)
class Samples:
    """What was read.

    values: by series its times [s] from a common origin, never descending, and its values, shape (N,) each;
    clock: the source of the times; start: UTC of time 0 where it is known; notes: what a person should know of them;
    metadata: those in the file.
    """

    values: Mapping[str, Part]
    clock: str
    start: datetime | None = None
    notes: Sequence[str] = ()
    metadata: Mapping[str, Any] = field(default_factory=dict)


class Source(Protocol):
    """A file of some format."""

    @property
    def kind(self) -> str:
        """What the format is called."""

    @property
    def series(self) -> Sequence[Series]:
        """All that it holds."""

    @property
    def notes(self) -> Sequence[str]:
        """What a person should know about the file."""

    def read(self, names: Sequence[str], choice: Choice) -> Samples:
        """The samples of these series.  Raises RecordingError."""


def shown(name: str) -> str:
    """A name without what would break a line, steer a terminal or fill a page."""
    plain = "".join(letter if letter.isprintable() else "?" for letter in name)
    return plain if len(plain) <= LONGEST_NAME else f"{plain[: LONGEST_NAME - 1]}…"


def reason(error: Exception) -> str:
    """A library's error about a file, on one line of bounded length."""
    return in_words(f"{type(error).__name__}: {error}")


def in_words(message: str) -> str:
    """A library's message on one line of bounded length, without its error's name where it has words."""
    kind, _, text = " ".join(message.split()).partition(": ")
    return shown(text if kind.isidentifier() and " " in text else message)


def too_many(name: str, count: int, what: str) -> RecordingError:
    """The error for a file that is no recording, however well it is formed."""
    return RecordingError(
        f"{name}: found {count} {what}, expected at most {MOST_SERIES}; is it a recording of signals?"
    )


def check_count(name: str, count: int) -> None:
    """Refuses what would not fit into memory.  Raises RecordingError."""
    if count > MOST_VALUES:
        raise RecordingError(
            f"{name}: found more than {MOST_VALUES} numbers in the chosen series, expected fewer; "
            "cut the recording into shorter ones"
        )
