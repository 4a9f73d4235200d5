"""The severity of a joint's wear from its last windows, its play and its trend.  Pure functions of values."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from lostmotion.daemon.options import AlarmOptions
from lostmotion.daemon.records import Origin, ScoreRow, Severity
from lostmotion.detector.median import median, weighted_quantile
from lostmotion.drivers.units import ARC_MINUTES

__all__ = ["LEAST_WINDOWS", "RANK", "Evidence", "grade"]

LEAST_WINDOWS = 5
"""fewer scored windows than this are no evidence"""


@dataclass(frozen=True, slots=True)
class Evidence:
    """windows: how many count; share: of them above the level; ratio: median of score / level; play: their size, the
    median with each window weighted by 1 / its interval [rad]; days: until the limit as the trend goes; origin: whose
    play it is, where joints share accelerometers; severity, severity_low: median equivalent play [rad] and median lower
    end of its interval, 0 where most windows may have no play.  NaN is unknown, and leads nowhere."""

    windows: int
    share: float
    ratio: float
    play: float = math.nan
    days: float = math.nan
    origin: Origin | None = None
    severity: float = math.nan
    severity_low: float = math.nan

    @classmethod
    def of(cls, windows: Sequence[ScoreRow], days: float, origin: Origin | None) -> Evidence:
        """The evidence of these windows, at least one, and of the trend."""
        ratios = [score.score / score.level for score in windows]
        known = [score for score in windows if math.isfinite(score.severity)]
        severity = severity_low = math.nan
        if len(known) >= LEAST_WINDOWS or len(known) == len(windows):
            severity = median(np.array([score.severity for score in known]))
            severity_low = median(np.array([score.severity_low for score in known]))
        return cls(
            len(ratios), sum(ratio > 1 for ratio in ratios) / len(ratios), median(np.array(ratios)),
            _play(windows), days, origin, severity, severity_low,
        )  # fmt: skip

    @property
    def proved(self) -> float:
        """The severity where most windows exclude that there is no play, else 0."""
        return self.severity if self.severity_low > 0 else 0.0

    def __str__(self) -> str:
        share = f"{self.share:.0%} of the last {self.windows} windows above the level"
        severity = f", severity {self.severity * ARC_MINUTES:.1f}'" if self.proved > 0 else ""
        size = f", play {self.play * ARC_MINUTES:.1f}'" if self.play == self.play else ""
        trend = f", at its limit in {self.days:.0f} days as its trend goes" if self.days == self.days else ""
        origin = f", {self.origin}" if self.origin else ""
        return f"play: {share}, median {self.ratio:.2g} x level{severity}{size}{trend}{origin}"


# From worst to best: which figure leads to a severity, and which option is its limit (None: no limit).
GRADES: tuple[tuple[Severity, Callable[[Evidence], float], Callable[[AlarmOptions], float | None]], ...] = (
    (Severity.ERROR, lambda evidence: evidence.proved, lambda options: options.severity_error),
    (Severity.ERROR, lambda evidence: evidence.ratio, lambda options: options.error),
    (Severity.ERROR, lambda evidence: evidence.play, lambda options: options.play_error),
    (Severity.WARNING, lambda evidence: evidence.proved, lambda options: options.severity_warning),
    (Severity.WARNING, lambda evidence: evidence.share, lambda options: options.warning),
    (Severity.WARNING, lambda evidence: evidence.play, lambda options: options.play_warning),
    (Severity.DEGRADED, lambda evidence: evidence.share, lambda options: options.degraded),
    (Severity.DEGRADED, lambda evidence: 1 / max(evidence.days, SOON), lambda options: _per(options.trend_days)),
)
SOON = 1e-3
"""fewer days than this are none"""
RANK: dict[Severity | None, int] = {None: 0, Severity.DEGRADED: 1, Severity.WARNING: 2, Severity.ERROR: 3}


def grade(evidence: Evidence, options: AlarmOptions, before: Severity | None) -> Severity | None:
    """The worst severity whose limit is reached.

    Deadband: what is in force ``before``, and all below it, is left only when the figure falls below 1 - deadband of
    its limit.
    """
    for severity, figure, limit in GRADES:
        bound = limit(options)
        if bound is None:
            continue
        held = RANK[severity] <= RANK[before]
        if figure(evidence) >= bound * (1 - options.deadband if held else 1.0):
            return severity
    return None


def _play(windows: Sequence[ScoreRow]) -> float:
    """The median play [rad], each window weighted by 1 / its interval where all have one, as ``pooling.pooled``: of
    an elbow of 4 mrad on a busy computer medians of 12 windows were 4.0 to 8.3 mrad, weighted ones 3.9 to 5.0."""
    plays = np.array([(one.play, one.play_high - one.play_low) for one in windows if math.isfinite(one.play)])
    if not plays.size:
        return math.nan
    width = plays[:, 1]
    weights = 1 / np.maximum(width, 1e-12) if np.isfinite(width).all() else np.ones(width.size)
    return weighted_quantile(plays[:, 0], weights, 0.5)


def _per(days: float) -> float | None:
    return 1 / days if days else None
