"""What a plot needs of any number of scores: least, largest and median values in equal pieces of time."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from lostmotion.detector.median import median

__all__ = ["EXTREMES", "extremes_of"]

VALUES = ("score", "severity", "play")
EXTREMES = ("time_us", "count", "impacts", "level", *(f"{name}_{what}" for name in VALUES
            for what in ("low", "high")), *(f"{name}_median" for name in VALUES))  # fmt: skip
"""the columns of a piece"""
EXTREMES_OF = (
    "SELECT min(time_us), count(*), sum(impact), max(level), min(score), max(score), min(severity), max(severity),"
    " min(play), max(play) {of}"
)
FIRST_OF = f"SELECT {', '.join(VALUES)} {{of}} ORDER BY time_us LIMIT 25"
"""the median of 25 windows is close enough for a plot, and takes as long however many there are"""


def extremes_of(db: sqlite3.Connection, of: str, span: Mapping[str, Any], pieces: int) -> list[tuple[Any, ...]]:
    """A row with the columns of EXTREMES for each of so many pieces that holds scores, in time order.

    of: FROM and WHERE of the scores of a joint between ``:since`` and ``:until`` [us], which ``span`` has beside its
    other parameters.  The medians are those of a piece's first windows; None for a piece without such a value.  Windows
    that a boundary separates from others just before it, such as those of one short motion, are one piece: a plot would
    show two values at one time.
    """
    width = max(-(-(span["until"] - span["since"]) // pieces), 1)
    rows: list[tuple[Any, ...]] = []
    for start in range(span["since"], span["until"], width):
        piece = {**span, "since": start, "until": min(start + width, span["until"])}
        row = _row(db, of, piece)
        if row and rows and row[0] - rows[-1][0] < width / 2:
            rows[-1] = _row(db, of, {**piece, "since": rows[-1][0]}) or row
        elif row:
            rows.append(row)
    return rows


def _row(db: sqlite3.Connection, of: str, piece: Mapping[str, Any]) -> tuple[Any, ...] | None:
    """The columns of EXTREMES of a piece; None without scores.  A question for each piece takes half the time of GROUP
    BY, which sorts a million rows that are in order."""
    row = db.execute(EXTREMES_OF.format(of=of), piece).fetchone()
    if row[0] is None:
        return None
    return (*row, *map(_median, zip(*db.execute(FIRST_OF.format(of=of), piece), strict=True)))


def _median(values: Iterable[float | None]) -> float | None:
    known = np.array([value for value in values if value is not None])
    return median(known) if known.size else None
