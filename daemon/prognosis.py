"""When a joint will reach its limit, from its trend in the database; the service computes it now and then."""

from __future__ import annotations

import math
from datetime import datetime, timedelta

import numpy as np

from lostmotion.daemon.reader import Reader
from lostmotion.detector.normalise import normalised
from lostmotion.detector.trend import LEAST_SPAN_S, mann_kendall, theil_sen, time_to_limit

__all__ = ["days_to_limit"]

LOOK_BACK = timedelta(days=180)
SAMPLES = 250
"""scores that speak for all: their pairs take 5 ms, which the main thread may be away"""
LEAST_SCORES = 30
ALPHA = 0.01


def days_to_limit(reader: Reader, joint: str, now: datetime, severity_limit: float, ahead_days: float = 0.0) -> float:
    """Days until the median line through the severities of the last half year meets ``severity_limit`` [rad]; NaN when
    there is no such trend.  ahead_days: how far ahead the caller looks; where that is more than half a year, so much of
    the past counts, as far as there are scores.

    Where most of the scores are from before there were severities, their line until the level counts.  The rise has to
    be significant (Mann-Kendall, 1 %), and the line is not drawn on for longer than it has been seen.
    """
    scores = reader.sampled(joint, now - _look_back(reader, joint, now, ahead_days), now, SAMPLES)
    if len(scores) < LEAST_SCORES or (scores[-1].time - scores[0].time).total_seconds() < LEAST_SPAN_S:
        return math.nan
    known = [score for score in scores if math.isfinite(score.severity)]
    is_known = len(known) >= max(LEAST_SCORES, len(scores) / 2)
    scores = known if is_known else scores
    times = [(score.time - scores[0].time).total_seconds() for score in scores]
    moved = {"excitation": np.log([score.excitation for score in scores]),
             "temperature": np.array([score.temperature for score in scores])}  # fmt: skip
    values, _ = normalised(np.array([score.severity if is_known else score.score for score in scores]), moved)
    if mann_kendall(values, ALPHA).direction != "rising":
        return math.nan
    left = time_to_limit(theil_sen(times, values), times[-1], severity_limit if is_known else scores[-1].level)
    if left is None or left.likely > times[-1]:
        return math.nan
    return max(left.likely - (now - scores[-1].time).total_seconds(), 0.0) / 86400


def _look_back(reader: Reader, joint: str, now: datetime, ahead_days: float) -> timedelta:
    """How much of the past counts."""
    extent = reader.extent(joint) if ahead_days > LOOK_BACK.days else None
    if extent is None:
        return LOOK_BACK
    known = (now - extent[0]) / timedelta(days=1)
    return max(LOOK_BACK, timedelta(days=min(known, ahead_days)))
