"""Levels from scores: eq. 9, Youden's J and a quantile of healthy scores."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lostmotion.detector.errors import DetectorError
from lostmotion.detector.level import Level, from_healthy, level, youden


def test_separable_scores_give_the_middle_of_the_gap() -> None:
    """Where the paper divides by zero twice: half-way between the loudest healthy and the quietest worn window."""
    result = level([1.0, 2.0, 3.0, 9.0, 10.0], [0, 0, 0, 1, 1])
    assert result == Level(6.0, 3.0 + 4.0, 2, 3, 0, 0, separable=True)


def test_eq_9_by_hand() -> None:
    """Scores 1h 2h 3w 4h 5w 6w: with one added to each count, both gaps next to the overlap give 4/2 + 3/1 = 5."""
    scores, labels = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0], [0, 0, 1, 0, 1, 1]
    # Above 2.5: accept 3, reject 2, positive 1, negative 0, so 4/2 + 3/1 = 5.
    # Above 4.5: accept 2, reject 3, positive 0, negative 1, so 3/1 + 4/2 = 5.  A tie: the lower one.
    result = level(scores, labels)
    assert (result.value, result.criterion) == (2.5, 5.0)
    counts = (result.correct_accept, result.correct_reject, result.false_positive, result.false_negative)
    assert counts == (3, 2, 1, 0)


def test_of_equally_good_levels_the_widest_gap_wins() -> None:
    """The same order as above with the upper gap wider: the level moves there."""
    assert level([1.0, 2.0, 3.0, 4.0, 8.0, 9.0], [0, 0, 1, 0, 1, 1]).value == 6.0


def test_youden_does_not_care_how_many_of_each() -> None:
    """Ten times as many healthy windows of the same kind move eq. 9's level and leave Youden's where it was."""
    rng = np.random.default_rng(30)
    healthy, worn = rng.lognormal(1.2, 0.4, 400), rng.lognormal(2.3, 0.5, 400)

    def both(times: int) -> tuple[Level, Level]:
        scores = np.concatenate([np.repeat(healthy, times), worn])
        labels = np.repeat([False, True], [400 * times, 400])
        return level(scores, labels), youden(scores, labels)

    (eq9_once, youden_once), (eq9_often, youden_often) = both(1), both(10)
    assert youden_often.value == youden_once.value
    assert eq9_often.value != eq9_once.value
    assert youden_once.false_positive + youden_once.false_negative < eq9_once.false_positive + eq9_once.false_negative


@given(
    st.lists(st.tuples(st.integers(0, 20), st.booleans()), min_size=2, max_size=60).filter(
        lambda pairs: len({worn for _, worn in pairs}) == 2 and len({score for score, _ in pairs}) > 1
    )
)
def test_no_level_is_better(pairs: list[tuple[int, bool]]) -> None:
    """Against every other level, counted one by one, eq. 9 (with one added) and J are at their greatest."""
    scores, worn = np.array([s for s, _ in pairs], dtype=float), np.array([w for _, w in pairs])
    result, other = level(scores, worn), youden(scores, worn)
    for value in np.unique(scores)[:-1] + 0.5:
        accept, positive = np.sum(worn & (scores > value)), np.sum(~worn & (scores > value))
        reject, negative = np.sum(~worn & (scores <= value)), np.sum(worn & (scores <= value))
        assert (accept + 1) / (positive + 1) + (reject + 1) / (negative + 1) <= result.criterion + 1e-12
        assert accept / worn.sum() - positive / (~worn).sum() <= other.criterion + 1e-12
    assert result.correct_accept == np.sum(worn & (scores > result.value))
    assert result.false_positive == np.sum(~worn & (scores > result.value))
    assert result.correct_accept + result.correct_reject + result.false_positive + result.false_negative == scores.size


def test_nan_scores_do_not_count() -> None:
    """Windows that could not be scored are left out."""
    assert level([1.0, math.nan, 3.0], [0, 0, 1]) == level([1.0, 3.0], [0, 1])


@pytest.mark.parametrize(
    ("scores", "labels", "words"),
    [
        ([1.0, 2.0], [0, 0], "0 scores with play and 2 without"),
        ([1.0, 2.0], [1, 1], "2 scores with play and 0 without"),
        ([2.0, 2.0], [0, 1], "all 2 scores are 2"),
        ([1.0, 2.0], [1], "2 scores and 1 labels"),
        ([], [], "0 scores with play"),
    ],
)
def test_scores_that_tell_no_level_are_refused(scores: list[float], labels: list[int], words: str) -> None:
    """One class, all ties, or unequal lengths: the message has what was found."""
    with pytest.raises(DetectorError, match=words):
        level(scores, labels)


def test_a_level_from_healthy_windows_keeps_its_promise() -> None:
    """Over 400 calibrations on 199 windows each, new windows exceed the 1 % level in 1 % of cases."""
    rng = np.random.default_rng(31)
    levels = [from_healthy(rng.lognormal(size=199), 0.01).value for _ in range(400)]
    fresh = np.sort(rng.lognormal(size=100_000))
    alarms = 1 - np.searchsorted(fresh, levels, side="right") / fresh.size
    assert alarms.mean() == pytest.approx(0.01, abs=0.002)


def test_too_few_healthy_windows_are_refused() -> None:
    """1 % needs 99 windows: 98 are too few, and of 99 it is the loudest."""
    with pytest.raises(DetectorError, match="at least 99"):
        from_healthy(np.arange(98.0), 0.01)
    assert from_healthy(np.arange(99.0), 0.01).value == 98.0
