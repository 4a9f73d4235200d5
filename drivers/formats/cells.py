"""The cells of a table as text: numbers, dates and times of day.  Pure functions of text."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from datetime import UTC, datetime

import numpy as np

__all__ = ["date", "is_date", "number"]

NOTHING = {"", "nan", "null", "none", "na", "n/a", "-", "--", "?", "#n/a", "undefined"}
"""cells that stand for no number, in lower case"""
WITH_COMMA = re.compile(r"\s*[+-]?\d*,\d+(?:[eE][+-]?\d+)?\s*")
CLOCK = re.compile(r"(?:(\d{1,2}):)?(\d{1,2}):(\d{1,2}(?:[.,]\d+)?)")
"""a time of day, or since the beginning: hours may be missing"""
DAY_FIRST = re.compile(r"(\d{1,2})[./-](\d{1,2})[./-](\d{4})[ T]+(.+)")
DAY = np.datetime64("1970-01-01", "ns")
"""of times without a date"""


def number(cell: str, decimal_comma: bool) -> float | None:
    """NaN for an empty cell, None for a word."""
    if cell.strip().lower() in NOTHING:
        return math.nan
    try:
        return float(cell.replace(",", ".") if decimal_comma and WITH_COMMA.fullmatch(cell) else cell)
    except ValueError:
        return None


def date(cell: str) -> np.datetime64:
    """A date with its time, or a time of day, whose date is taken as 1970-01-01; NaT for another text."""
    text = cell.strip()
    if found := CLOCK.fullmatch(text):
        seconds = 3600 * int(found[1] or 0) + 60 * int(found[2]) + float(found[3].replace(",", "."))
        return DAY + np.timedelta64(round(seconds * 1e9), "ns")
    if (found := DAY_FIRST.fullmatch(text)) and not np.isnat(clock := date(found[4])):
        first, second = int(found[1]), int(found[2])
        day, month = (first, second) if second <= 12 else (second, first)
        return _iso(f"{found[3]}-{month:02d}-{day:02d}") + (clock - DAY)
    return _iso(text.replace(",", ".") if len(text) > 19 else text)


def _iso(text: str) -> np.datetime64:
    try:
        time = datetime.fromisoformat(text)
    except ValueError:
        return np.datetime64("NaT", "ns")
    utc = time.astimezone(UTC) if time.tzinfo else time.replace(tzinfo=UTC)
    return np.datetime64(utc.replace(tzinfo=None), "ns")


def is_date(rows: Sequence[Sequence[str]], index: int, decimal_comma: bool) -> bool:
    """Whether all cells of a column are dates or times, and none is a number."""
    cells = [row[index] for row in rows if index < len(row) and row[index].strip()]
    return bool(cells) and not any(np.isnat(date(cell)) or number(cell, decimal_comma) is not None for cell in cells)
