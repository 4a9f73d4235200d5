"""The answers to queries on Zenoh: alarms, status and history from the database, and the newest message on each key.

Keys under ``lostmotion/<robot>/``: ``status``, ``alarms``, ``<joint>/history?since=…;until=…;limit=…``,
``<joint>/series?since=…;until=…``,
``<joint>/alarm``, ``<joint>/health``.  Payloads only; the sink handles the queries.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import closing
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import msgspec

from lostmotion.daemon import documents, times
from lostmotion.daemon.reader import Reader, open_readonly
from lostmotion.daemon.zenoh_session import SCHEMA
from lostmotion.detector.trend import MOST
from lostmotion.drivers.errors import LostmotionError

__all__ = ["DEFAULT_ROWS", "LONG", "MOST_ROWS", "PARAMETERS", "Answers", "BadQueryError", "payload"]

PARAMETERS = ("since", "until", "limit")
DEFAULT_ROWS, MOST_ROWS = 1000, 10_000
"""scores in one answer: unless asked for, and at most"""
LONG = ("/history", "/series")
"""keys whose answers may be long: only who asks for them by name gets them"""


class BadQueryError(LostmotionError):
    """A query's parameters cannot be understood."""


class Answers:
    """Answers from the database at ``database``; ``latest`` holds the newest payloads by (key, kind)."""

    def __init__(self, database: Path, latest: Mapping[tuple[str, str], bytes]) -> None:
        self._database = database
        self._latest = latest

    def names(self) -> list[str]:
        """The keys that have an answer now."""
        with closing(open_readonly(self._database)) as reader:
            long = [f"{row.name}{ending}" for row in reader.joints() for ending in LONG]
        return [*dict.fromkeys(key for key, _ in list(self._latest)), *long, "alarms", "status"]

    def to(self, key: str, parameters: Mapping[str, str]) -> Iterator[bytes]:
        """The payloads for one of these keys.  Raises BadQueryError or ReaderError."""
        if key.endswith(("/alarm", "/health")):
            yield from [content for (name, _), content in list(self._latest.items()) if name == key]
            return
        with closing(open_readonly(self._database)) as reader:
            if key == "alarms":
                alarms = [documents.alarm(alarm) for alarm in reader.active_alarms()]
                yield payload({"robot": reader.robot(), "alarms": alarms})
            elif key == "status":
                yield payload(documents.status(reader))
            else:
                joint, _, kind = key.rpartition("/")
                yield payload((_history if kind == "history" else _series)(reader, joint, parameters))


def payload(document: Mapping[str, Any]) -> bytes:
    """A document as JSON, with the number of its schema; null for what is unknown."""
    return msgspec.json.encode({"schema": SCHEMA} | dict(document))


def _history(reader: Reader, joint: str, parameters: Mapping[str, str]) -> dict[str, Any]:
    """The newest scores with since <= time < until, oldest first; complete: whether these are all."""
    since, until = _span(f"{joint}/history", parameters)
    limit = _limit(joint, parameters.get("limit", str(DEFAULT_ROWS)))
    scores = reader.scores(joint, since, until, limit + 1)
    return documents.history(joint, scores[-limit:]) | {"complete": len(scores) <= limit}


def _series(reader: Reader, joint: str, parameters: Mapping[str, str]) -> dict[str, Any]:
    """The scores with since <= time < until from which a trend is computed: one an hour where there are many."""
    return documents.series(joint, reader.series(joint, *_span(f"{joint}/series", parameters), most=MOST))


def _span(key: str, parameters: Mapping[str, str]) -> tuple[datetime | None, datetime | None]:
    now = datetime.now(UTC)
    try:
        since, until = (times.parse(parameters[key], now) if key in parameters else None for key in ("since", "until"))
        times.check_order(since, until)
    except times.TimeError as error:
        raise BadQueryError(f"{key}: {error}") from error
    return since, until


def _limit(joint: str, asked: str) -> int:
    try:
        limit = int(asked)
    except ValueError:
        limit = 0
    if limit < 1:
        raise BadQueryError(f"{joint}/history: found limit={asked}, expected 1 to {MOST_ROWS}")
    return min(limit, MOST_ROWS)
