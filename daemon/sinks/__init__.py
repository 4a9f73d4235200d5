"""Sinks: where scores, alarms and health go besides the database.  A sink raises no error of its far end."""

from __future__ import annotations

from typing import Protocol

from lostmotion.daemon.records import JointRow, ScoreRow, Transition

__all__ = ["Sink"]


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
