"""Why a joint has its health now: an alarm keeps the reason for which it was raised, and play goes on growing."""

from __future__ import annotations

import re
from collections.abc import Sequence

from lostmotion.daemon.evidence import Evidence
from lostmotion.daemon.options import AlarmOptions
from lostmotion.daemon.reader import Reader
from lostmotion.daemon.records import AlarmRow, Cause, JointRow, Origin

__all__ = ["others", "present_reason"]

TREND = re.compile(r"at its limit in (\d+) days")
"""what a reason says of the trend"""


def others(joint: str, origins: Sequence[Origin]) -> str:
    """Whose play the impacts in a joint's windows are, "" where they may be its own."""
    return next((str(one) for one in origins if joint in one.probabilities and one.spares(joint)), "")


def present_reason(reader: Reader, joint: JointRow, alarms: Sequence[AlarmRow], windows: int = 0) -> str:
    """The reason for a joint's health, with the figures of its newest sound windows in the place of those for which an
    alarm of play was raised.

    alarms: those of the joint that are not normal; windows: how many count, 0 for the default of ``[alarm]``.  When the
    limit is reached, and whose play it is, remains as the service has it.
    """
    raised = next((one for one in alarms if one.cause is Cause.PLAY and one.cleared is None), None)
    if raised is None or raised.reason not in joint.reason:
        return joint.reason
    newest = reader.scores(joint.name, limit=windows or AlarmOptions().windows)
    sound = [score for score in newest if score.quality == "ok"]
    if not sound:
        return joint.reason
    days = TREND.search(raised.reason)
    origin = next((one for one in reader.origins() if str(one) in raised.reason), None)
    now = Evidence.of(sound, float(days[1]) if days else float("nan"), origin)
    return joint.reason.replace(raised.reason, str(now))
