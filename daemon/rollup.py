"""Old scores become one an hour: the sound window whose score is the median of its hour stays, the others go.

The choice is one piece of SQL (``CHOSEN``), by which old scores are deleted (``roll_up``) and long histories are read
(``hourly``): a trend over years is the same before and after.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["DAY_US", "HOUR_US", "SERIES", "Series", "hourly", "roll_up"]

SERIES = np.dtype([("time_us", "i8"), ("score", "f8"), ("level", "f8"), ("impact", "?"), ("sound", "?"),
                   ("play", "f8"), ("excitation", "f8"), ("temperature", "f8"), ("severity", "f8")])  # fmt: skip
"""scores that are numbers, in time order; what else is unknown is infinite"""
Series = NDArray[Any]

HOUR_US = 3_600_000_000
DAY_US = 24 * HOUR_US
DONE = "SELECT value FROM meta WHERE key = ?"
SPAN = "FROM score WHERE joint_id = :joint AND time_us >= :since AND time_us < :until"
RANK = "CASE WHEN score IS NULL THEN 2 WHEN quality IS NULL THEN 0 ELSE 1 END"
"""sound, only a number, not even that"""
CHOSEN = f"""{SPAN} ORDER BY {RANK}, score, time_us LIMIT 1
OFFSET (SELECT (count(*) - 1) / 2 {SPAN} GROUP BY {RANK} ORDER BY {RANK} LIMIT 1)"""
"""of the scores in a span of time: the best of them are put in order, and the middle one is chosen"""
DELETE = f"DELETE {SPAN} AND time_us != (SELECT time_us {CHOSEN})"


def roll_up(db: sqlite3.Connection, joint: int, until_us: int) -> bool:
    """Rolls up the oldest hour of a joint that still has to be, if it ends before ``until_us`` [µs since 1970].

    To be called within a transaction.  Returns whether there was such an hour.
    """
    key = f"rolled up to, joint {joint}"
    done = int((db.execute(DONE, [key]).fetchone() or ["0"])[0])
    hour = next(_hours(db, joint, done, until_us), None)
    if hour is None or hour["until"] % HOUR_US:
        return False
    db.execute(DELETE, hour)
    db.execute("INSERT OR REPLACE INTO meta VALUES (?, ?)", [key, str(hour["until"])])
    return True


def hourly(db: sqlite3.Connection, columns: str, joint: int, since_us: int, until_us: int) -> Iterator[tuple[Any, ...]]:
    """The columns of the rows that rolling up would leave, in time order."""
    for hour in _hours(db, joint, since_us, until_us):
        yield from db.execute(f"SELECT {columns} {CHOSEN}", hour)


def _hours(db: sqlite3.Connection, joint: int, since_us: int, until_us: int) -> Iterator[dict[str, int]]:
    """The hours in which there are scores, as parameters of SPAN; the last one ends at ``until_us``."""
    span = {"joint": joint, "since": since_us, "until": until_us}
    while (first := db.execute(f"SELECT min(time_us) {SPAN}", span).fetchone()[0]) is not None:
        end = min(first - first % HOUR_US + HOUR_US, until_us)
        yield span | {"since": first, "until": end}
        span["since"] = end
