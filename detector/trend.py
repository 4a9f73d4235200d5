"""Wear over months: slope, significance, changes and the time left, from scores in time order.

Scores of neighbouring windows are correlated and have heavy tails, so all methods here are rank-based or median-based
and allow for serial correlation.  NaN are left out.  No plots, no dates: times are seconds.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lostmotion.detector.changes import change_points
from lostmotion.detector.errors import DetectorError
from lostmotion.detector.forecast import TimeToLimit, forecast
from lostmotion.detector.median import median, medians
from lostmotion.detector.window import FloatArray

__all__ = [
    "LEAST_SPAN_S",
    "MOST",
    "Slope",
    "Trend",
    "WearTrend",
    "mann_kendall",
    "summarise",
    "theil_sen",
    "time_to_limit",
]

HOUR_S = 3600.0
"""Scores of so many seconds are one point of the search for changes, as they are in an old history.  In a year of 37
motions of 13 windows whose means scatter nearly as much as the windows (0.4 and 0.5 in the logarithm) changes were
found in 93 of 100 healthy joints by windows, in 1 by motions (tests/detector/test_trend.py)."""
MOST = 1000
"""More points than this are first replaced by the medians of as many runs of consecutive points: all pairs of 1000 take
milliseconds, and medians of runs keep the trend."""
LEAST = 3
REPAIRED = 0.7
"""A change after which scores are below this share of those before is a repair."""
LEAST_RECENT = 10
"""Least points since the last change for a separate slope."""
LEAST_SPAN_S = 7 * 86400.0
"""A slope over less is weather (a warm gearbox, another job), not wear [s]."""


@dataclass(frozen=True, slots=True)
class Slope:
    """A line: slope [1/s] with its confidence interval low..high, intercept at time 0, centre: the median time [s]."""

    slope: float
    low: float
    high: float
    intercept: float
    centre: float

    def at(self, time: float) -> float:
        """The line's value at a time [s]."""
        return self.intercept + self.slope * time


@dataclass(frozen=True, slots=True)
class Trend:
    """Mann-Kendall: p_value (two-sided), tau in -1..1, direction "rising", "falling" or "none"; inflation: factor of
    serial correlation on the variance of the statistic."""

    p_value: float
    tau: float
    direction: str
    inflation: float


@dataclass(frozen=True, slots=True)
class WearTrend:
    """The trend of months of scores.

    count: scores used; first, last: their times [s]; slope, trend: over all of them; change_points: times [s] at which
    level or slope changed; recent: the slope since the last change; current: its value at ``last``, at least 0; limit:
    the level; time_to_limit: by ``recent``, None when it does not reach the limit; forecast: from the scores since the
    last repair, over several laws of wear, None for too few of them; no_forecast: why both are None although the limit
    lies ahead, "" where they may be told.
    """

    count: int
    first: float
    last: float
    slope: Slope
    trend: Trend
    change_points: tuple[float, ...]
    recent: Slope
    current: float
    limit: float
    time_to_limit: TimeToLimit | None
    forecast: TimeToLimit | None
    no_forecast: str


def theil_sen(t: ArrayLike, y: ArrayLike, inflation: float = 1.0) -> Slope:
    """The median of the slopes between all pairs (Theil 1950), its 95 % interval after Sen (1968), corrected for ties.

    t [s] and y, shape (N,); above 1000 points by medians of runs.  inflation: factor on the variance of Kendall's
    statistic, 1 for independent errors; ``mann_kendall`` estimates it.  The intercept is that of the median point.

    Raises DetectorError for fewer than 3 points, or when all times are the same.
    """
    time, value = _clean(t, y)
    first, second = np.triu_indices(time.size, 1)
    steps = time[second] - time[first]
    distinct = steps > 0
    slopes = np.sort((value[second] - value[first])[distinct] / steps[distinct])
    if slopes.size == 0:
        raise DetectorError(f"all {time.size} points are at the time {time[0]:g} s; expected different times")
    spread = math.sqrt(inflation * _kendall_variance(time.size, time, value))
    half = _quantile(0.975) * spread
    low = max(round((slopes.size - half) / 2) - 1, 0)
    high = min(round((slopes.size + half) / 2), slopes.size - 1)
    slope, centre = median(slopes), median(time)
    intercept = median(value) - slope * centre
    return Slope(slope, float(slopes[low]), float(slopes[high]), intercept, centre)


def mann_kendall(y: ArrayLike, alpha: float = 0.05) -> Trend:
    """Whether y, shape (N,) in time order, rises or falls: Kendall's S against its variance under no trend.

    The variance is corrected for ties, and for serial correlation after Hamed and Rao (1998): by the autocorrelation of
    the ranks of the detrended series, over the lags before the first that is not significant; never below that of
    independent values, as negative correlations are unreliable.  At a correlation of 0.6 a test at 5 % gives false
    alarms in 8 to 11 % of trend-free series of 80 to 400 points (uncorrected: 31 to 38 %).

    Raises DetectorError for fewer than 3 points.
    """
    values = np.asarray(y, dtype=float)
    index, value = _clean(np.arange(values.size, dtype=float), values)
    count = value.size
    s = float(np.sum(np.sign(value[None, :] - value[:, None]) * np.triu(np.ones((count, count)), 1)))
    variance = _kendall_variance(count, value)
    inflation = _hamed_rao(value - theil_sen(index, value).slope * index)
    z = (s - math.copysign(1, s)) / math.sqrt(variance * inflation) if s and variance else 0.0
    p_value = math.erfc(abs(z) / math.sqrt(2))
    direction = "none" if p_value >= alpha else "rising" if s > 0 else "falling"
    return Trend(p_value, s / (count * (count - 1) / 2), direction, inflation)


def time_to_limit(slope: Slope, now: float, limit: float) -> TimeToLimit | None:
    """When the line reaches the limit; None when it never does, zeros when it already has.

    The interval is from lines with the ends of the slope's interval through the median point.  now [s]; limit: in the
    units of y.
    """
    middle = slope.at(slope.centre)
    if slope.at(now) >= limit:
        return TimeToLimit(0.0, 0.0, 0.0)
    if slope.high <= 0:
        return None

    def wait(rate: float) -> float:
        return max(slope.centre + (limit - middle) / rate - now, 0.0) if rate > 0 else math.inf

    return TimeToLimit(wait(slope.slope), wait(slope.high), wait(slope.low))


def summarise(times: ArrayLike, scores: ArrayLike, level: float) -> WearTrend:
    """The trend of a joint's history: times [s], ascending, and scores, shape (N,), against the level.

    The time until the level is told only where wear can be seen: a significant rise, over at least ``LEAST_SPAN_S``.

    Raises DetectorError for fewer than 3 scores that are numbers.
    """
    time, score = np.asarray(times, dtype=float), np.asarray(scores, dtype=float)
    there = np.isfinite(time) & np.isfinite(score)
    time, score = time[there], score[there]
    trend = mann_kendall(score)
    slope = theil_sen(time, score, inflation=trend.inflation)
    changes = _changes(time, score)
    recent = slope
    if changes and score.size - changes[-1] >= LEAST_RECENT:
        since = slice(changes[-1], None)
        recent = theil_sen(time[since], score[since], inflation=mann_kendall(score[since]).inflation)
    first, last = float(time[0]), float(time[-1])
    current, left, predicted, doubt = recent.at(last), None, None, ""
    if current < level:
        doubt = _doubt(trend, recent, last - first)
    if not doubt:
        left = time_to_limit(recent, last, level)
        worn = slice(_repair(score, changes), None)
        predicted = forecast(time[worn], score[worn], level)
    at = tuple(float(time[i]) for i in changes)
    return WearTrend(
        score.size, first, last, slope, trend, at, recent, max(current, 0.0), level, left, predicted, doubt
    )


def _changes(time: FloatArray, score: FloatArray) -> list[int]:
    """Indices at which level or slope changed, between hours: of the medians of each hour's scores.

    The windows of one motion share its load and speed, and are no independent evidence of a change of the gear.
    """
    begins = np.flatnonzero(np.diff(time // HOUR_S, prepend=-math.inf))
    return [int(begins[hour]) for hour in change_points(medians(score, np.append(begins, score.size)))]


def _doubt(trend: Trend, recent: Slope, span: float) -> str:
    """Why no time until the limit is told, "" where one may be.  A rise since the last change counts, too: the interval
    of its slope excludes zero where Kendall's test is significant."""
    if trend.direction != "rising" and recent.low <= 0:
        return "no rise is found"
    if span < LEAST_SPAN_S:
        return f"the history is shorter than {LEAST_SPAN_S / 86400:.0f} days"
    return ""


def _repair(score: FloatArray, changes: list[int]) -> int:
    """Index of the last change at which the scores fell: a repair, from which wear begins anew; 0 without one."""
    falls = [
        i
        for i in changes
        if np.median(score[i : i + LEAST_RECENT]) < REPAIRED * np.median(score[max(i - LEAST_RECENT, 0) : i])
    ]
    return falls[-1] if falls else 0


def _clean(t: ArrayLike, y: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Finite points only, at least three, at most ``MOST``."""
    time, value = np.asarray(t, dtype=float), np.asarray(y, dtype=float)
    if time.shape != value.shape or time.ndim != 1:
        raise DetectorError(f"{time.size} times and {value.size} values; expected as many of both")
    there = np.isfinite(time) & np.isfinite(value)
    time, value = time[there], value[there]
    if time.size < LEAST:
        raise DetectorError(f"usable points: found {time.size}, expected at least {LEAST}")
    if time.size > MOST:
        ends = np.linspace(0, time.size, MOST + 1).astype(int)
        time, value = medians(time, ends), medians(value, ends)
    return time, value


def _quantile(share: float) -> float:
    """Of the standard normal distribution."""
    from statistics import NormalDist  # half a megabyte, which a service needs once there is a trend

    return NormalDist().inv_cdf(share)


def _kendall_variance(count: int, *ranked: FloatArray) -> float:
    """Variance of Kendall's S for independent values, corrected for ties in each of the variables."""
    tied = sum(_tie_term(np.unique(values, return_counts=True)[1]) for values in ranked)
    return (count * (count - 1) * (2 * count + 5) - tied) / 18


def _tie_term(counts: NDArray[np.intp]) -> float:
    return float(np.sum(counts * (counts - 1) * (2 * counts + 5)))


def _hamed_rao(detrended: FloatArray) -> float:
    """n / n* of Hamed and Rao (1998), eq. 13: the inflation of Kendall's variance, at least 1."""
    n = detrended.size
    _, inverse, counts = np.unique(detrended, return_inverse=True, return_counts=True)
    ranks = (np.cumsum(counts) - (counts - 1) / 2)[inverse]
    centred = ranks - ranks.mean()
    power = float(centred @ centred)
    if power == 0:
        return 1.0
    significant = _quantile(0.975) / math.sqrt(n)
    total = 0.0
    for lag in range(1, n - 2):
        correlation = float(centred[:-lag] @ centred[lag:]) / power
        if abs(correlation) <= significant:
            break
        total += (n - lag) * (n - lag - 1) * (n - lag - 2) * correlation
    return max(1.0, 1 + 2 * total / (n * (n - 1) * (n - 2)))
