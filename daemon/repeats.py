"""Problems that repeat: when to report them.  No log, no clock: the time is an argument."""

from __future__ import annotations

import traceback
from dataclasses import dataclass, field

__all__ = ["Condition", "Repeats", "place"]

AWAY_S = 60.0
"""a problem that has not been met for so long has gone away [s]"""
STAYS_S = 20.0
"""one that comes back sooner, and stays for so long, is reported: the last report would be false.  Of a router
that died seconds after its return it was for a minute (seed 904 of ``bench.faults``, which asks for 30 s) [s]"""
REMIND_S = 3600.0
"""how often one that stays is reported [s]"""


@dataclass(slots=True)
class Repeats:
    """Problems by their texts, and when each was reported and last met [s]."""

    _known: dict[str, tuple[float, float]] = field(default_factory=dict)

    def is_news(self, problem: str, now: float) -> bool:
        """Whether to report a problem that is met now [s]: the first time, after it had gone away, or again after an
        hour."""
        self._known = {words: (reported, met) for words, (reported, met) in self._known.items() if now - met < AWAY_S}
        reported, _ = self._known.get(problem, (float("-inf"), 0.0))
        is_news = now - reported >= REMIND_S
        self._known[problem] = (now if is_news else reported, now)
        return is_news


class Condition:
    """A state, well or a problem, that may change every second, as with a loose plug.

    reported: the last report, "" for well, None for none yet.
    """

    def __init__(self, reported: str | None = None) -> None:
        self._now: tuple[str | None, float] = (None, 0.0)
        self._reported = reported
        self._repeats = Repeats()

    def is_news(self, problem: str, now: float) -> bool:
        """Whether to report the present state [s], "" for well: of a flutter only its beginning and its end are."""
        before, since = self._now
        if problem != before:
            self._now = (problem, now)
            is_news = self._repeats.is_news(problem, now) if problem else self._reported != ""
        else:
            is_news = bool(problem) and problem != self._reported and now - since >= STAYS_S
        if is_news:
            self._reported = problem
        return is_news


def place(error: BaseException) -> str:
    """Where an error was raised, and of which kind it is: its words may hold figures that differ each time."""
    frame = traceback.extract_tb(error.__traceback__)[-1]
    return f"{type(error).__name__}, {frame.filename}:{frame.lineno}"
