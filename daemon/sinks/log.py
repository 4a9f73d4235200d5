"""The log as a sink: health and alarms as warnings, scores as debugging lines; ``key=value`` after the sentence."""

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
            log.debug(
                "score joint=%s time=%s score=%.3g level=%g impact=%s quality=%s",
                *(row.joint, iso(row.time), row.score, row.level, row.impact, row.quality),
            )

    def alarm(self, transition: Transition, again: bool = False) -> None:
        if again:
            return
        row = transition.alarm
        bad = logging.ERROR if row.severity is Severity.ERROR else logging.WARNING
        log.log(
            bad if transition.event in NEWS else logging.INFO,
            "alarm joint=%s cause=%s severity=%s event=%s state=%s reason=%r%s",
            *(row.joint, row.cause.value, row.severity.value, transition.event.value, row.state.value, row.reason),
            f" by={transition.by}" if transition.by else "",
        )

    def health(self, row: JointRow) -> None:
        """Another reason for the same health is an alarm's affair."""
        if self._healths.get(row.name) is row.health:
            return
        self._healths[row.name] = row.health
        good = row.health in (Health.OK, Health.DEGRADED)
        log.log(
            logging.INFO if good else logging.WARNING,
            "health joint=%s health=%s reason=%r",
            *(row.name, row.health.value, row.reason),
        )

    def close(self) -> None:
        """Nothing is held open."""
