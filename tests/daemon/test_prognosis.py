"""What a joint's trend says to the service: days until the limit, or nothing."""

from __future__ import annotations

import math
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

from lostmotion.daemon.prognosis import days_to_limit
from lostmotion.daemon.reader import open_readonly
from lostmotion.daemon.records import ScoreRow
from lostmotion.daemon.store import Store

START = datetime(2026, 1, 1, tzinfo=UTC)


def prognosis_days(
    folder: Path, days: float, per_day: float, count: int = 2000, since: float = math.inf, ahead: float = 30.0
) -> float:
    """Days until level 8 for scores from 2 on that rise by so much a day, with noise; since: the day from which on
    there are severities [mrad] that rise alike, while the scores no longer do."""
    store, noise = Store(folder / "history.db", "arm"), np.random.default_rng(1)
    for k in range(count):
        day = days * k / count
        score = 2 + per_day * day + 0.5 * noise.standard_normal()
        severity = 1e-3 * score if day >= since else math.nan
        score = min(score, 5.0) if since < math.inf else score
        store.add(ScoreRow("elbow", START + timedelta(days=day), 0.25, score, 8.0, False, severity=severity))
    store.close()
    with open_readonly(folder / "history.db") as reader:
        return days_to_limit(reader, "elbow", START + timedelta(days=days), 10e-3, ahead)


def test_a_steady_rise_is_drawn_on(tmp_path: Path) -> None:
    """0.04 a day from 2: level 8 after 150 days, seen from day 100: 50 left."""
    assert prognosis_days(tmp_path, 100, 0.04) == pytest.approx(50, abs=5)


def test_severities_count_where_there_are_enough(tmp_path: Path) -> None:
    """0.04 mrad a day from 2: 10 mrad after 200 days, seen from day 150 or from day 50: 50 left, although the score
    stands still; with an eighth of the rows the scores count."""
    (tmp_path / "whole").mkdir()
    assert prognosis_days(tmp_path / "whole", 150, 0.04, since=0) == pytest.approx(50, abs=8)
    (tmp_path / "half").mkdir()
    assert prognosis_days(tmp_path / "half", 150, 0.04, since=50) == pytest.approx(50, abs=12)
    for name in ("late", "none"):
        (tmp_path / name).mkdir()
    assert prognosis_days(tmp_path / "late", 150, 0.04, since=130) == prognosis_days(
        tmp_path / "none", 150, 0.04, since=150
    )


@pytest.mark.parametrize(("days", "per_day"), [(100, 0.0), (100, -0.05), (100, 0.02), (5, 0.5)])
def test_nothing_is_promised_where_nothing_tells(tmp_path: Path, days: float, per_day: float) -> None:
    """Level, falling, reached only after twice the time that was seen, or seen for less than a week: NaN."""
    assert math.isnan(prognosis_days(tmp_path, days, per_day))


@pytest.mark.parametrize(
    ("days", "per_day", "ahead", "left"),
    [
        (300, 0.01, 30.0, math.nan),  # 300 days left, of which half a year of scores promises none
        (300, 0.0105, 365.0, 271),
        (300, 0.0105, 1e9, 271),
        (100, 0.04, 365.0, 50),
    ],
)
def test_who_looks_far_ahead_looks_far_back(
    tmp_path: Path, days: float, per_day: float, ahead: float, left: float
) -> None:
    """A limit that is nine months away is found from ten months of scores where ``trend_days`` is a year or more, and
    not from half a year of them; few scores are no obstacle."""
    assert prognosis_days(tmp_path, days, per_day, ahead=ahead) == pytest.approx(left, abs=20, nan_ok=True)
