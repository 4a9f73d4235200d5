"""Sinks: where scores, alarms and health go besides the database.  A sink raises no error of its far end.

``registry.py`` has the table of sinks; other packages add rows to it (docs/adding-a-sink.md).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from lostmotion.daemon.options import SinkOptions
from lostmotion.daemon.records import JointRow, ScoreRow, Transition

__all__ = ["Sink", "SinkContext", "SinkFactory", "SinkOptions", "SinkType"]


class Sink(Protocol):
    """Takes events in order, from one thread; must return at once."""

    def score(self, row: ScoreRow) -> None:
        """Every scored window."""
        ...

    def alarm(self, transition: Transition, again: bool = False) -> None:
        """Every transition of an alarm, once it is stored; again: an earlier run may have published it already."""
        ...

    def health(self, row: JointRow) -> None:
        """A joint's health, once at the start and whenever it changes."""
        ...

    def close(self) -> None:
        """The service ends."""
        ...


@dataclass(frozen=True, slots=True)
class SinkContext:
    """The name of the robot, the names of all joints in the order of the configuration, and the path of the
    database."""

    robot: str
    joints: tuple[str, ...]
    database: Path


SinkFactory = Callable[[Any, SinkContext], Sink]
"""from the sink's own options"""


@dataclass(frozen=True, slots=True)
class SinkType:
    """One row of the table of sinks.

    name: of its table ``[alarm.NAME]``, whose keys are ``options``; open: makes the sink, without waiting for its far
    end; package: what must be installed for it; addresses: what it connects to, for ``config check``.
    """

    name: str
    summary: str
    open: SinkFactory
    options: type[SinkOptions] = SinkOptions
    package: str = ""
    addresses: Callable[[Any], tuple[str, ...]] | None = None
