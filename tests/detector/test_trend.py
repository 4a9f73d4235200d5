"""Trends against closed forms, other people's implementations, and their own promises on random series."""

from __future__ import annotations

import math

import numpy as np
import pymannkendall
import pytest
from scipy import stats

from lostmotion.detector.errors import DetectorError
from lostmotion.detector.trend import Slope, mann_kendall, summarise, theil_sen, time_to_limit

DAY = 86400.0


def autocorrelated(rng: np.random.Generator, count: int, rho: float) -> np.ndarray:
    """A stationary first-order series of unit variance."""
    out = rng.normal(size=count)
    for index in range(1, count):
        out[index] = rho * out[index - 1] + math.sqrt(1 - rho**2) * out[index]
    return out


def test_slope_of_a_line() -> None:
    """A line is its own slope, with an interval of no width; three outliers of thirty change nothing."""
    time = np.arange(30.0)
    exact = theil_sen(time, 2 + 0.5 * time)
    assert (exact.slope, exact.low, exact.high, exact.intercept) == pytest.approx((0.5, 0.5, 0.5, 2.0))
    assert exact.at(100.0) == pytest.approx(52.0)
    spoilt = 2 + 0.5 * time
    spoilt[[3, 11, 25]] = [1e6, -1e6, 1e6]
    assert theil_sen(time, spoilt).slope == pytest.approx(0.5, abs=0.02)


@pytest.mark.parametrize("ties", [False, True])
def test_slope_agrees_with_scipy(ties: bool) -> None:
    """Slope, interval and intercept of scipy.stats.theilslopes, with and without ties."""
    rng = np.random.default_rng(40)
    time, value = np.sort(rng.uniform(0, 50, 80)), rng.normal(size=80)
    if ties:
        time, value = np.round(time), np.round(value)
    ours, theirs = theil_sen(time, value), stats.theilslopes(value, time, 0.95)
    assert (ours.slope, ours.intercept) == pytest.approx((theirs.slope, theirs.intercept))
    assert (ours.low, ours.high) == pytest.approx((theirs.low_slope, theirs.high_slope), rel=0.02, abs=1e-3)


def test_interval_covers_the_true_slope() -> None:
    """95 % intervals cover in 93 to 98 % of 400 series with heavy-tailed errors."""
    rng = np.random.default_rng(41)
    time = np.arange(60.0)
    results = [theil_sen(time, 0.02 * time + rng.standard_t(2, 60)) for _ in range(400)]
    covered = np.mean([r.low <= 0.02 <= r.high for r in results])
    assert 0.93 <= covered <= 0.98


def test_inflation_widens_the_interval_of_correlated_errors() -> None:
    """Errors with a correlation of 0.6: the plain 95 % interval covers less than 72 %, the corrected one over 87 %."""
    rng = np.random.default_rng(42)
    time = np.arange(150.0)
    plain, corrected = [], []
    for _ in range(400):
        value = autocorrelated(rng, 150, 0.6)
        plain.append(theil_sen(time, value))
        corrected.append(theil_sen(time, value, inflation=mann_kendall(value).inflation))
    covered = [np.mean([r.low <= 0 <= r.high for r in results]) for results in (plain, corrected)]
    assert covered[0] < 0.72
    assert covered[1] > 0.87


def test_independent_values_agree_with_pymannkendall() -> None:
    """tau and p of the original test, with ties, where no correlation is significant."""
    value = np.round(np.random.default_rng(43).normal(size=60) + 0.02 * np.arange(60), 1)
    ours, theirs = mann_kendall(value), pymannkendall.original_test(value)
    assert ours.inflation == 1.0
    assert (ours.tau, ours.p_value) == pytest.approx((theirs.Tau, theirs.p), rel=1e-9)


def test_correlated_values_agree_with_pymannkendall() -> None:
    """p of Hamed and Rao's test over the same lags: those before the first that is not significant."""
    value = autocorrelated(np.random.default_rng(44), 120, 0.7)
    ours = mann_kendall(value)
    lags = next(
        lag
        for lag in range(2, 60)
        if pymannkendall.hamed_rao_modification_test(value, lag=lag).var_s
        == pymannkendall.hamed_rao_modification_test(value, lag=lag - 1).var_s
    )
    theirs = pymannkendall.hamed_rao_modification_test(value, lag=lags - 1)
    assert ours.inflation > 2
    assert ours.p_value == pytest.approx(theirs.p, rel=1e-9)


@pytest.mark.parametrize(("rho", "most"), [(0.0, 0.07), (0.3, 0.10), (0.6, 0.12)])
def test_false_trends_are_rare(rho: float, most: float) -> None:
    """At 5 %, series of 200 without a trend give one in little more, even when correlated (0.3 of them uncorrected)."""
    rng = np.random.default_rng(45)
    found = np.mean([mann_kendall(autocorrelated(rng, 200, rho)).direction != "none" for _ in range(200)])
    assert found <= most


def test_direction() -> None:
    """Rising, falling and neither."""
    rng = np.random.default_rng(46)
    noise, line = rng.normal(size=100), np.linspace(0, 3, 100)
    directions = [mann_kendall(series).direction for series in (noise + line, noise - line, noise)]
    assert directions == ["rising", "falling", "none"]
    assert mann_kendall(np.ones(10)).p_value == 1.0
    assert mann_kendall([1.0, 2.0, math.nan, 3.0, 4.0]).tau == 1.0


@pytest.mark.parametrize("values", [[], [1.0, 2.0], [1.0, math.nan, math.nan, 2.0]])
def test_two_points_are_no_trend(values: list[float]) -> None:
    """Fewer than three usable points are refused, with their number."""
    with pytest.raises(DetectorError, match=r"usable points: found [02], expected at least 3"):
        mann_kendall(values)
    with pytest.raises(DetectorError, match="usable points"):
        theil_sen(range(len(values)), values)


def test_points_at_one_time_are_refused() -> None:
    """Without any difference in time there is no slope."""
    with pytest.raises(DetectorError, match="all 3 points are at the time 5 s"):
        theil_sen([5.0, 5.0, 5.0], [1.0, 2.0, 3.0])


def test_a_year_of_scores() -> None:
    """100,000 scores: the slope within its interval, and that within 5 % of the truth."""
    rng = np.random.default_rng(47)
    time = np.sort(rng.uniform(0, 365 * DAY, 100_000))
    slope = theil_sen(time, 3 + 5 * time / (365 * DAY) + rng.exponential(size=100_000))
    assert slope.low < 5 / (365 * DAY) < slope.high
    assert slope.slope == pytest.approx(5 / (365 * DAY), rel=0.05)


def test_time_to_limit() -> None:
    """From 2 at time 0 with 0.01/s about time 50: limit 4 in 100 s from time 100; the interval's ends turn about 50."""
    line = Slope(slope=0.01, low=0.005, high=0.02, intercept=2.0, centre=50.0)
    left = time_to_limit(line, 100.0, 4.0)
    assert left is not None
    assert (left.likely, left.earliest, left.latest) == pytest.approx((100.0, 25.0, 250.0))
    unsure = time_to_limit(Slope(0.01, -0.005, 0.02, 2.0, 50.0), 100.0, 4.0)
    assert unsure is not None
    assert unsure.latest == math.inf
    assert time_to_limit(Slope(-0.01, -0.02, -0.001, 2.0, 50.0), 100.0, 4.0) is None
    over = time_to_limit(line, 300.0, 4.0)
    assert over is not None
    assert (over.likely, over.earliest, over.latest) == (0.0, 0.0, 0.0)


def test_summary_of_growing_wear() -> None:
    """Scores from 3 to 6 in 100 days: rising, no change on the way, and about 67 days to a level of 8."""
    rng = np.random.default_rng(48)
    time = np.arange(2400) * DAY / 24
    wear = summarise(time, 3 + 3 * time / (100 * DAY) + rng.normal(0, 0.5, 2400), 8.0)
    assert (wear.count, wear.first, wear.last, wear.limit) == (2400, 0.0, time[-1], 8.0)
    assert wear.trend.direction == "rising"
    assert wear.change_points == ()
    assert wear.current == pytest.approx(6.0, abs=0.1)
    assert wear.time_to_limit is not None
    assert wear.time_to_limit.earliest < 66.7 * DAY < wear.time_to_limit.latest
    assert wear.time_to_limit.likely == pytest.approx(66.7 * DAY, rel=0.05)


def test_no_value_is_below_zero() -> None:
    """A line through severities that end in a few small ones runs below zero at its end; no play is negative."""
    time = np.arange(40.0)
    wear = summarise(time, np.where(time < 25, 40 - 2 * time, 0.01), 60.0)
    assert wear.recent.at(wear.last) < -1.0
    assert wear.current == 0.0


def test_summary_looks_at_what_came_after_a_change() -> None:
    """Healthy for 60 days, then growing by 0.1 a day: the time left goes by the slope since the change."""
    rng = np.random.default_rng(49)
    time = np.arange(1000) * DAY / 10
    wear = summarise(time, 3 + np.maximum(time / DAY - 60, 0) * 0.1 + rng.normal(0, 0.3, 1000), 8.0)
    assert len(wear.change_points) == 1
    assert wear.change_points[0] / DAY == pytest.approx(60, abs=3)
    assert wear.recent.slope * DAY == pytest.approx(0.1, rel=0.05)
    assert wear.time_to_limit is not None
    assert wear.time_to_limit.likely / DAY == pytest.approx(10, abs=1)


def test_a_motion_is_no_change() -> None:
    """The windows of one motion share its load: 37 motions of 13 windows in a year show a change in one healthy joint
    of twenty at most, and a step between two of them in most."""
    false = found = 0
    for seed in range(20):
        rng = np.random.default_rng(seed)
        begins = (np.arange(37) * 9.7 + rng.random(37) / 12) * DAY
        time = (begins[:, None] + 0.3 * np.arange(13)).ravel()
        score = np.exp(rng.normal(0, 0.4, 37)[:, None] + rng.normal(0, 0.5, (37, 13))).ravel()
        false += bool(summarise(time, score, 10.0).change_points)
        changes = summarise(time, score + 5.0 * (time > 180 * DAY), 10.0).change_points
        found += any(abs(at - 180 * DAY) < 11 * DAY for at in changes)
    assert false <= 1
    assert found >= 16


def test_a_rise_since_the_last_change_is_drawn_on() -> None:
    """Falling for 60 days to a repair, then growing: the whole has no rise, what came after the change has one."""
    rng = np.random.default_rng(50)
    days = np.arange(1000) / 10
    values = np.where(days < 60, 8 - 0.02 * days, 1 + 0.05 * (days - 60)) + rng.normal(0, 0.1, 1000)
    wear = summarise(days * DAY, values, 10.0)
    assert wear.trend.direction != "rising"
    assert wear.no_forecast == ""
    assert wear.time_to_limit is not None
    assert wear.time_to_limit.likely / DAY == pytest.approx((9 - 2) / 0.05, rel=0.1)


@pytest.mark.parametrize("rate", [0.0, -0.01])
def test_a_limit_that_is_reached_needs_no_rise(rate: float) -> None:
    """Above the limit all the time, within an hour or falling: reached, not "no forecast"."""
    time = np.arange(100.0)
    wear = summarise(time, 20 + rate * time, 10.0)
    assert wear.no_forecast == ""
    assert wear.time_to_limit is not None
    assert wear.time_to_limit.likely == 0.0
