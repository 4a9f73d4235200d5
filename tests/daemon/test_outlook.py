"""What a joint's trend says to the service: days until the level, or nothing."""

from __future__ import annotations

import math
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

from lostmotion.daemon.outlook import days_to_level
from lostmotion.daemon.reader import open_readonly
from lostmotion.daemon.records import ScoreRow
from lostmotion.daemon.store import Store

START = datetime(2026, 1, 1, tzinfo=UTC)


def outlook(folder: Path, days: float, per_day: float, count: int = 2000) -> float:
    """Days until level 8 for scores from 2 on that rise by so much a day, with noise."""
    store, noise = Store(folder / "history.db", "arm"), np.random.default_rng(1)
    for k in range(count):
        day = days * k / count
        score = 2 + per_day * day + 0.5 * noise.standard_normal()
        store.add(ScoreRow("elbow", START + timedelta(days=day), 0.25, score, 8.0, False))
    store.close()
    with open_readonly(folder / "history.db") as reader:
        return days_to_level(reader, "elbow", START + timedelta(days=days))


def test_a_steady_rise_is_drawn_on(tmp_path: Path) -> None:
    """0.04 a day from 2: level 8 after 150 days, seen from day 100: 50 left."""
    assert outlook(tmp_path, 100, 0.04) == pytest.approx(50, abs=5)


@pytest.mark.parametrize(("days", "per_day"), [(100, 0.0), (100, -0.05), (100, 0.02), (5, 0.5)])
def test_nothing_is_promised_where_nothing_tells(tmp_path: Path, days: float, per_day: float) -> None:
    """Level, falling, reached only after twice the time that was seen, or seen for less than a week: NaN."""
    assert math.isnan(outlook(tmp_path, days, per_day))
