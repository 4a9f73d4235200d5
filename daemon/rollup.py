"""Old scores become one an hour: the sound window whose score is the median of its hour stays, the others go.

The same choice is made in two places: in the database (``roll_up``) and on columns of scores (``one_an_hour``), so that
a trend over years is the same before and after.
"""

from __future__ import annotations

import sqlite3
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["DAY_US", "HOUR_US", "SERIES", "Series", "one_an_hour", "roll_up"]

SERIES = np.dtype([("time_us", "i8"), ("score", "f8"), ("level", "f8"), ("impact", "?"), ("sound", "?"),
                   ("play", "f8"), ("excitation", "f8"), ("temperature", "f8"), ("severity", "f8")])  # fmt: skip
"""scores that are numbers, in time order; what else is unknown is infinite"""
Series = NDArray[Any]

HOUR_US = 3_600_000_000
DAY_US = 24 * HOUR_US
DONE = "SELECT value FROM meta WHERE key = ?"
FIRST = "SELECT min(time_us) FROM score WHERE joint_id = ? AND time_us >= ?"
# rank: sound, only a number, not even that; the best of an hour are put in order, and the middle one is chosen.
DELETE = f"""
WITH old AS (
    SELECT time_us, score, time_us / {HOUR_US} AS hour,
        CASE WHEN score IS NULL THEN 2 WHEN quality IS NULL THEN 0 ELSE 1 END AS rank
    FROM score WHERE joint_id = :joint AND time_us >= :since AND time_us < :until),
placed AS (
    SELECT time_us, rank, min(rank) OVER (PARTITION BY hour) AS best,
        row_number() OVER (PARTITION BY hour, rank ORDER BY score, time_us) AS place,
        count(*) OVER (PARTITION BY hour, rank) AS many
    FROM old)
DELETE FROM score WHERE joint_id = :joint AND time_us >= :since AND time_us < :until
    AND time_us NOT IN (SELECT time_us FROM placed WHERE rank = best AND place = (many + 1) / 2)
"""


def roll_up(db: sqlite3.Connection, joint: int, until_us: int) -> bool:
    """Rolls up the oldest hour of a joint that still has to be, if it ends before ``until_us`` [µs since 1970].

    To be called within a transaction.  Returns whether there was such an hour.
    """
    key = f"rolled up to, joint {joint}"
    done = int((db.execute(DONE, [key]).fetchone() or ["0"])[0])
    first = db.execute(FIRST, [joint, done]).fetchone()[0]
    if first is None or (until := first - first % HOUR_US + HOUR_US) > until_us:
        return False
    db.execute(DELETE, {"joint": joint, "since": done, "until": until})
    db.execute("INSERT OR REPLACE INTO meta VALUES (?, ?)", [key, str(until)])
    return True


def one_an_hour(series: Series) -> Series:
    """The rows that rolling up would leave, in time order."""
    hour, unsound = series["time_us"] // HOUR_US, ~series["sound"]
    order = np.lexsort((series["time_us"], series["score"], unsound, hour))
    hours, first, count = np.unique(hour[order], return_index=True, return_counts=True)
    sound = np.add.reduceat(series["sound"][order].astype(int), first) if hours.size else count
    of = np.where(sound > 0, sound, count)
    chosen: Series = series[np.sort(order[first + (of - 1) // 2])]
    return chosen
