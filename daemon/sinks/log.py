"""The log as a sink: health and alarms as warnings, scores as debugging lines; ``key=value`` for who reads lines, the
same as fields for journald.
"""

from __future__ import annotations

import logging

from lostmotion.daemon.records import AlarmEvent, Health, JointRow, ScoreRow, Severity, Transition, iso

__all__ = ["LogSink"]

log = logging.getLogger(__name__)

NEWS = (AlarmEvent.RAISED, AlarmEvent.ESCALATED, AlarmEvent.CHANGED, AlarmEvent.UNSHELVED, AlarmEvent.REMINDED)


class LogSink:
    """Writes one line for each event."""

    def __init__(self) -> None:
        self._healths: dict[str, Health] = {}

    def score(self, row: ScoreRow) -> None:
        if log.isEnabledFor(logging.DEBUG):
            score = {"score": f"{row.score:.3g}", "level": f"{row.level:g}", "impact": row.impact}
            _log_event(logging.DEBUG, "score", joint=row.joint, time=iso(row.time), **score, quality=row.quality)

    def alarm(self, transition: Transition, again: bool = False) -> None:
        if again:
            return
        row = transition.alarm
        bad = logging.ERROR if row.severity is Severity.ERROR else logging.WARNING
        what = {"joint": row.joint, "cause": row.cause.value, "severity": row.severity.value}
        what |= {"event": transition.event.value, "state": row.state.value, "reason": row.reason}
        _log_event(bad if transition.event in NEWS else logging.INFO, "alarm", **what, **_by(transition))

    def health(self, row: JointRow) -> None:
        """Logs another health; another reason for the same health is logged with its alarm."""
        if self._healths.get(row.name) is row.health:
            return
        self._healths[row.name] = row.health
        good = row.health in (Health.OK, Health.DEGRADED)
        level = logging.INFO if good else logging.WARNING
        _log_event(level, "health", joint=row.name, health=row.health.value, reason=row.reason)

    def close(self) -> None:
        """Nothing is held open."""


def _by(transition: Transition) -> dict[str, str]:
    return {"by": transition.by} if transition.by else {}


def _log_event(level: int, kind: str, /, **fields: object) -> None:
    """A line such as ``alarm joint=elbow reason='…'``; what may hold blanks is quoted."""
    pairs = (f"{key}={value!r}" if key == "reason" else f"{key}={value}" for key, value in fields.items())
    log.log(level, "%s %s", kind, " ".join(pairs), extra={"fields": {"kind": kind} | fields})
