"""The health of a joint and its alarms: what the last windows and the devices say.  No I/O; time comes in.

Two causes are followed side by side: the play that is heard, and the devices that should hear it.  Each has at most one
active alarm; the joint's health is the worse of both.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from datetime import datetime
from statistics import median

from lostmotion.daemon.options import AlarmOptions
from lostmotion.daemon.records import AlarmRow, Cause, Health, JointRow, ScoreRow, Severity

__all__ = ["Evidence", "JointMonitor"]

HOLD = 0.6
"""hysteresis: a health is left when the figure that led to it falls below this share of its limit"""
LEAST_WINDOWS = 5
"""fewer scored windows than this say nothing"""
SEVERITY: dict[Health, Severity | None] = {
    Health.OK: None,
    Health.DEGRADED: None,
    Health.WARNING: Severity.WARNING,
    Health.ERROR: Severity.ERROR,
}
RANK = {health: rank for rank, health in enumerate(Health)}


@dataclass(frozen=True, slots=True)
class Evidence:
    """What the last windows show: share of them above the level, and median of score / level."""

    windows: int
    share: float
    ratio: float

    def __str__(self) -> str:
        share = f"{self.share:.0%} of the last {self.windows} windows above the level"
        return f"play: {share}, median {self.ratio:.2g} x level"


# From worst to best: which figure leads to a health, and which option is its limit.
GRADES: tuple[tuple[Health, Callable[[Evidence], float], Callable[[AlarmOptions], float]], ...] = (
    (Health.ERROR, lambda evidence: evidence.ratio, lambda options: options.error),
    (Health.WARNING, lambda evidence: evidence.share, lambda options: options.warning),
    (Health.DEGRADED, lambda evidence: evidence.share, lambda options: options.degraded),
)


class JointMonitor:
    """Follows one joint.  ``row`` is its health; every method returns the rows that changed, to be stored and told.

    row, recent (scores, oldest first) and active (alarms) carry on where an earlier run stopped.
    """

    def __init__(
        self, row: JointRow, options: AlarmOptions, recent: Iterable[ScoreRow] = (), active: Iterable[AlarmRow] = ()
    ) -> None:
        self.row = row
        self._options = options
        self._ratios: deque[float] = deque(maxlen=options.windows)
        self._ratios.extend(score.score / score.level for score in recent if score.quality == "ok")
        self._active = {alarm.cause: alarm for alarm in active}
        play = self._active.get(Cause.PLAY)
        self._play = next((health for health in Health if play and SEVERITY[health] is play.severity), Health.OK)
        self._fault = self._active[Cause.DEVICE].reason if Cause.DEVICE in self._active else ""

    def scored(self, score: ScoreRow) -> list[AlarmRow | JointRow]:
        """Takes one scored window; what its quality puts in doubt does not count."""
        if score.quality != "ok":
            return []
        self._ratios.append(score.score / score.level)
        self._play = self._grade()
        return self._update(score.time)

    def device(self, fault: str, time: datetime) -> list[AlarmRow | JointRow]:
        """Takes what is wrong with the joint's servo or accelerometer; "" when nothing is."""
        self._fault = fault
        return self._update(time)

    def _evidence(self) -> Evidence:
        above = sum(ratio > 1 for ratio in self._ratios)
        return Evidence(len(self._ratios), above / len(self._ratios), median(self._ratios))

    def _grade(self) -> Health:
        if len(self._ratios) < LEAST_WINDOWS:
            return self._play
        evidence = self._evidence()
        for health, figure, limit in GRADES:
            factor = HOLD if RANK[health] <= RANK[self._play] else 1.0
            if figure(evidence) >= factor * limit(self._options):
                return health
        return Health.OK

    def _update(self, time: datetime) -> list[AlarmRow | JointRow]:
        changes: list[AlarmRow | JointRow] = []
        play = str(self._evidence()) if self._ratios and self._play is not Health.OK else ""
        changes += self._set(Cause.PLAY, SEVERITY[self._play], play, time)
        changes += self._set(Cause.DEVICE, Severity.ERROR if self._fault else None, self._fault, time)
        health = Health.ERROR if self._fault else self._play
        if health is not self.row.health or (self._fault and self._fault != self.row.reason):
            self.row = JointRow(self.row.name, health, self._fault or play, time)
            changes.append(self.row)
        return changes

    def _set(self, cause: Cause, severity: Severity | None, reason: str, time: datetime) -> list[AlarmRow | JointRow]:
        """Clears or raises the alarm of a cause when its severity changes; a device that fails otherwise is told."""
        old = self._active.get(cause)
        if (old.severity if old else None) is severity:
            if old is None or cause is Cause.PLAY or old.reason == reason:
                return []
            self._active[cause] = replace(old, reason=reason)
            return [self._active[cause]]
        changes: list[AlarmRow | JointRow] = []
        if old:
            changes.append(replace(self._active.pop(cause), cleared=time))
        if severity:
            self._active[cause] = AlarmRow(self.row.name, cause, severity, time, reason)
            changes.append(self._active[cause])
        return changes
