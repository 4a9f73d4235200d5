"""Old scores become one an hour, and no trend changes by it."""

from __future__ import annotations

import json
import math
import sqlite3
from contextlib import closing
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

from lostmotion.daemon.reader import open_readonly
from lostmotion.daemon.records import ScoreRow, micros
from lostmotion.daemon.rollup import roll_up
from lostmotion.daemon.store import Store
from tests.daemon.cli_world import call
from tests.daemon.conftest import wait_until

START = datetime(2020, 1, 1, tzinfo=UTC)
DAYS = 120
A_DAY = 30
NAN, QUALITY = math.nan, {True: "ok", False: "gap"}
HOURS = 5
"""in which a day's scores lie"""


def worn(joint: str, seed: int) -> list[ScoreRow]:
    """Four months of scores in bursts, five and more an hour, that rise fourfold with noise; some of them unsound."""
    random = np.random.default_rng(seed)
    rows = []
    for day in range(DAYS):
        for k in range(A_DAY):
            time = START + timedelta(days=day, hours=8 + k // 6, seconds=float(60 * k + random.uniform(0, 30)))
            score = float(math.exp(0.0116 * day + random.normal(0.0, 0.4)))
            quality = "gap" if random.uniform() < 0.1 else "ok"
            rows.append(ScoreRow(joint, time, 0.25, math.nan if k == 7 else score, 8.0, score > 8, quality=quality))
    return rows


@pytest.fixture(scope="module")
def rows() -> list[ScoreRow]:
    """Two joints of a robot, in time order."""
    return sorted([*worn("elbow", 1), *worn("wrist", 2)], key=lambda row: row.time)


def stored(path: Path, rows: list[ScoreRow]) -> Path:
    """A database in which they all are."""
    store = Store(path, "arm1")
    store.add(*rows)
    store.close()
    return path


def rolled_up(path: Path, until: datetime) -> Path:
    """The same, with all hours before that time rolled up."""
    with closing(sqlite3.connect(path)) as db, db:
        for joint in (1, 2):
            while roll_up(db, joint, micros(until)):
                pass
    return path


def test_the_median_window_of_each_old_hour_stays(tmp_path: Path, rows: list[ScoreRow]) -> None:
    """Of every old hour one row is left, unchanged: the sound one of median score; new ones all stay."""
    limit = START + timedelta(days=80)
    with open_readonly(rolled_up(stored(tmp_path / "history.db", rows), limit)) as reader:
        kept = reader.scores("elbow")
    given = [row for row in rows if row.joint == "elbow"]
    assert [row.time for row in kept if row.time >= limit] == [row.time for row in given if row.time >= limit]
    old = [row for row in kept if row.time < limit]
    assert len(old) == 80 * HOURS
    for row in old[:: HOURS + 1]:
        hour = row.time.replace(minute=0, second=0, microsecond=0)
        all_of_it = [other for other in given if hour <= other.time < hour + timedelta(hours=1)]
        sound = [other for other in all_of_it if other.quality == "ok" and math.isfinite(other.score)]
        assert row == sorted(sound, key=lambda other: other.score)[(len(sound) - 1) // 2]


def test_trends_are_the_same_before_and_after(tmp_path: Path, rows: list[ScoreRow]) -> None:
    """Slope, interval, significance, changes and time to the limit of `lostmotion trend` do not move at all."""
    path = stored(tmp_path / "history.db", rows)
    before = json.loads(call("trend", "elbow", "--json", "--database", path).stdout)
    rolled_up(path, START + timedelta(days=80))
    after = json.loads(call("trend", "elbow", "--json", "--database", path).stdout)
    assert before["mann_kendall"]["direction"] == "rising"
    assert after == before


def test_a_running_store_rolls_up(tmp_path: Path, rows: list[ScoreRow]) -> None:
    """While rows come in, what has become old disappears little by little; nothing of the last days does."""
    path = stored(tmp_path / "history.db", rows)
    store = Store(path, "arm1", keep_scores_days=DAYS - 10)

    def is_rolled_up() -> bool:
        store.add(rows[-1])
        with open_readonly(path) as reader:
            return len(reader.scores("wrist", until=START + timedelta(days=8))) == 8 * HOURS

    wait_until(is_rolled_up)
    with open_readonly(path) as reader:
        assert len(reader.scores("wrist", since=START + timedelta(days=11))) == (DAYS - 11) * A_DAY
    store.close()


def test_a_long_series_is_one_an_hour(tmp_path: Path) -> None:
    """Per hour: the lower median of the sound scores, or of all numbers where none is sound; nothing where there is no
    number.  A short series is whole."""
    hours = {
        0: [(5, True), (1, True), (3, True), (9, False)],
        2: [(4, False), (2, False)],
        3: [(7, True)],
        4: [(NAN, True)],
    }
    rows = [
        ScoreRow("elbow", START + timedelta(hours=hour, seconds=k), 0.25, score, 8.0, False, quality=QUALITY[sound])
        for hour, scores in hours.items()
        for k, (score, sound) in enumerate(scores)
    ]
    with open_readonly(stored(tmp_path / "history.db", rows)) as reader:
        assert reader.series("elbow", most=6)["score"].tolist() == [3.0, 2.0, 7.0]
        assert reader.series("elbow", most=7)["score"].tolist() == [5.0, 1.0, 3.0, 9.0, 4.0, 2.0, 7.0]
        within = START + timedelta(seconds=1), START + timedelta(hours=2, seconds=1)
        assert reader.series("elbow", *within, most=1)["score"].tolist() == [1.0, 4.0]
        assert reader.series("elbow", START + timedelta(hours=4), most=0).size == 0
