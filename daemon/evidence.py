"""What a joint's last windows, its play and its trend say of its health.  Pure functions of values."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from lostmotion.daemon.options import AlarmOptions
from lostmotion.daemon.records import Origin, Severity

__all__ = ["LEAST_WINDOWS", "RANK", "Evidence", "grade"]

LEAST_WINDOWS = 5
"""fewer scored windows than this say nothing"""


@dataclass(frozen=True, slots=True)
class Evidence:
    """windows: how many count; share: of them above the level; ratio: median of score / level; play: its median size
    [rad]; days: until the score reaches the level as its trend goes.  NaN is unknown, and leads nowhere.  origin: whose
    play it is, where joints share accelerometers."""

    windows: int
    share: float
    ratio: float
    play: float = math.nan
    days: float = math.nan
    origin: Origin | None = None

    def __str__(self) -> str:
        share = f"{self.share:.0%} of the last {self.windows} windows above the level"
        size = f", {math.degrees(self.play) * 60:.1f}' wide" if self.play == self.play else ""
        trend = f", reaching it in {self.days:.0f} days as its trend goes" if self.days == self.days else ""
        origin = f", {self.origin}" if self.origin else ""
        return f"play: {share}, median {self.ratio:.2g} x level{size}{trend}{origin}"


# From worst to best: which figure leads to a severity, and which option is its limit (None: no limit).
GRADES: tuple[tuple[Severity, Callable[[Evidence], float], Callable[[AlarmOptions], float | None]], ...] = (
    (Severity.ERROR, lambda evidence: evidence.ratio, lambda options: options.error),
    (Severity.ERROR, lambda evidence: evidence.play, lambda options: options.play_error),
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
        held = RANK[severity] <= RANK[before]
        bound = limit(options)
        if bound is not None and figure(evidence) >= bound * (1 - options.deadband if held else 1.0):
            return severity
    return None


def _per(days: float) -> float | None:
    return 1 / days if days else None
