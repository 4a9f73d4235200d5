"""Whether the sinks reach what is behind them, as the service sees it.  Reads no clock."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import datetime

from lostmotion.daemon.records import SinkRow, SinkRows
from lostmotion.daemon.sinks import Sink

__all__ = ["SinkStates"]


class SinkStates:
    """The states of sinks by their names; a change is a row for the database.

    A sink tells its state by an attribute ``problem``: what keeps it from sending, "" for nothing.  One of another
    package may have none; its state is unknown.
    """

    def __init__(self, sinks: Mapping[str, Sink]) -> None:
        self._sinks = sinks
        self._rows: dict[str, SinkRow] = {}
        self._is_told = False

    def look(self, utc: datetime) -> list[SinkRows]:
        """The states, where one has changed since the last look; at the first look in any case."""
        before, self._rows = self._rows, {name: self._row(name, utc) for name in self._sinks}
        if self._is_told and before == self._rows:
            return []
        self._is_told = True
        return [SinkRows(tuple(self._rows.values()))]

    def _row(self, name: str, utc: datetime) -> SinkRow:
        before, problem = self._rows.get(name), getattr(self._sinks[name], "problem", None)
        is_up = None if problem is None else not problem
        since = before.since if before and before.is_up == is_up else utc
        return SinkRow(name, is_up, since, problem or (before.error if before else ""))
