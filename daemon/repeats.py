"""What goes wrong again and again: when to tell it.  No log, no clock: time comes in."""

from __future__ import annotations

import traceback
from dataclasses import dataclass, field

__all__ = ["Condition", "Repeats", "place"]

AWAY_S = 60.0
"""a problem that has not been met for so long has gone away [s]"""
STAYS_S = 20.0
"""one that comes back sooner, and stays for so long, is told after all: what was told last would be false.  Of a router
that died seconds after its return it was for a minute (seed 904 of ``bench.faults``, which asks for 30 s) [s]"""
REMIND_S = 3600.0
"""how often one that stays is told [s]"""


@dataclass(slots=True)
class Repeats:
    """Problems by their words, and when each was told and last met [s]."""

    _known: dict[str, tuple[float, float]] = field(default_factory=dict)

    def is_news(self, problem: str, now: float) -> bool:
        """Whether to tell a problem that is met now [s]: for the first time, after it had gone away, or once more after
        an hour."""
        self._known = {words: (told, met) for words, (told, met) in self._known.items() if now - met < AWAY_S}
        told, _ = self._known.get(problem, (float("-inf"), 0.0))
        is_news = now - told >= REMIND_S
        self._known[problem] = (now if is_news else told, now)
        return is_news


class Condition:
    """A thing that is well or has a problem, and may change between the two every second: a loose plug.

    told: what has been told of it, None for nothing yet.
    """

    def __init__(self, told: str | None = None) -> None:
        self._now: tuple[str | None, float] = (None, 0.0)
        self._told = told
        self._repeats = Repeats()

    def is_news(self, problem: str, now: float) -> bool:
        """Whether to tell how it is now [s], "" for well: only the beginning of a flutter is, and what it ends in."""
        before, since = self._now
        if problem != before:
            self._now = (problem, now)
            is_news = self._repeats.is_news(problem, now) if problem else self._told != ""
        else:
            is_news = bool(problem) and problem != self._told and now - since >= STAYS_S
        if is_news:
            self._told = problem
        return is_news


def place(error: Exception) -> str:
    """Where an error was raised, and of which kind it is: its words may hold figures that differ each time."""
    frame = traceback.extract_tb(error.__traceback__)[-1]
    return f"{type(error).__name__}, {frame.filename}:{frame.lineno}"
