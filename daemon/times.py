"""Times as people type and read them.  No clock: what "ago" refers to comes in as an argument."""

from __future__ import annotations

import re
from datetime import UTC, datetime, timedelta

from lostmotion.daemon.records import iso
from lostmotion.drivers.errors import LostmotionError

__all__ = ["TimeError", "ago", "check_order", "length", "local", "parse", "span"]

UNITS_S = {"s": 1.0, "m": 60.0, "min": 60.0, "h": 3600.0, "d": 86400.0, "w": 7 * 86400.0, "y": 365.25 * 86400.0}
LENGTH = re.compile(r"(\d+(?:\.\d+)?)\s*([a-z]+)")
STEPS = (("y", 365.25 * 86400.0), ("months", 30.4375 * 86400.0), ("d", 86400.0), ("h", 3600.0), ("min", 60.0))


class TimeError(LostmotionError):
    """A text that is no time, or times in the wrong order."""


def parse(text: str, now: datetime) -> datetime:
    """UTC of ``30d``, ``12h``, ``90min``, ``2w`` (that long before ``now``), or of ISO 8601; without a zone, UTC.

    Raises TimeError.
    """
    text = text.strip()
    try:
        if LENGTH.fullmatch(text):
            return now - timedelta(seconds=length(text))
        stamp = datetime.fromisoformat(text)
        return stamp.replace(tzinfo=UTC) if stamp.tzinfo is None else stamp.astimezone(UTC)
    except (ValueError, OverflowError) as error:
        raise TimeError(
            f"found the time {text!r}, expected one such as 30d, 12h, 2026-01-31 or {iso(now)[:19]}Z"
        ) from error


def length(text: str) -> float:
    """Seconds of ``8h``, ``30min``, ``2w``.  Raises TimeError."""
    found = LENGTH.fullmatch(text.strip())
    if not found or found[2] not in UNITS_S:
        raise TimeError(f"found the length of time {text!r}, expected one such as 8h, 30min or 2w")
    return float(found[1]) * UNITS_S[found[2]]


def check_order(since: datetime | None, until: datetime | None) -> None:
    """Raises TimeError for a period that ends before it begins."""
    if since and until and until <= since:
        raise TimeError(
            f"found --until {iso(until)[:19]}Z, expected a time after --since {iso(since)[:19]}Z; are they swapped?"
        )


def span(seconds: float) -> str:
    """A length of time in its largest useful unit: ``3 s``, ``12 min``, ``5.2 months``."""
    for unit, length in STEPS:
        if abs(seconds) >= 2 * length:
            count = seconds / length
            return f"{count:.1f} {unit}" if abs(count) < 10 and unit in ("y", "months", "d") else f"{count:.0f} {unit}"
    return f"{seconds:.0f} s"


def ago(time: datetime, now: datetime) -> str:
    """How long ago; the future (of a simulated robot) is written as "in …"."""
    seconds = (now - time).total_seconds()
    return f"in {span(-seconds)}" if seconds < -1 else f"{span(max(seconds, 0.0))} ago"


def local(time: datetime) -> str:
    """For tables: UTC to the tenth of a second."""
    return f"{time.astimezone(UTC):%Y-%m-%d %H:%M:%S}.{time.microsecond // 100_000}"
