"""ROS 2's diagnostic_msgs/DiagnosticArray as rmw_zenoh sends it.  No I/O, no clock.

No package of ROS is needed: the form of keys and tokens is in ``drivers/codec/rmw_zenoh.py``, CDR in
``drivers/codec/cdr.py``.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime

from lostmotion.daemon.records import AlarmRow, Cause, Health, JointRow, ScoreRow, micros
from lostmotion.drivers.codec import rmw_zenoh
from lostmotion.drivers.codec.cdr import CdrWriter
from lostmotion.drivers.units import ARC_MINUTES

__all__ = ["Board", "key", "tokens"]

TOPIC = "diagnostics"
TYPE = "diagnostic_msgs/msg/DiagnosticArray"
HASH = "RIHS01_5a8a36efb05fb25070fa0fb3810290c0e6cd4862b54a8fb975a1ee8dc55a333e"
NODE = "lostmotion"
LEVEL = {Health.OK: 0, Health.DEGRADED: 1, Health.WARNING: 1, Health.ERROR: 2}
STALE = 3


@dataclass(frozen=True, slots=True)
class Status:
    """A DiagnosticStatus: level 0 OK, 1 WARN, 2 ERROR, 3 STALE."""

    level: int
    name: str
    message: str
    hardware_id: str
    values: tuple[tuple[str, str], ...]


class Board:
    """The newest state of each joint of a robot, as one message."""

    def __init__(self, robot: str) -> None:
        self._robot = robot
        self._health: dict[str, JointRow] = {}
        self._scores: dict[str, ScoreRow] = {}
        self._alarms: dict[tuple[str, Cause], AlarmRow] = {}

    def score(self, row: ScoreRow) -> None:
        self._scores[row.joint] = row

    def alarm(self, row: AlarmRow) -> None:
        self._alarms[row.joint, row.cause] = row

    def health(self, row: JointRow) -> None:
        self._health[row.name] = row

    def message(self, time: datetime) -> bytes:
        """The DiagnosticArray of all joints, stamped with a time."""
        return encode([self._status(row) for row in list(self._health.values())], time)

    def _status(self, row: JointRow) -> Status:
        device = self._alarms.get((row.name, Cause.DEVICE))
        level = STALE if device and device.is_active and row.health is not Health.ERROR else LEVEL[row.health]
        values = [("health", row.health.value)]
        if last := self._scores.get(row.name):
            values += [("score", f"{last.score:.4g}"), ("level", f"{last.level:.4g}")]
            sizes = {"play [arcmin]": last.play, "severity [arcmin]": last.severity}
            values += [(name, f"{size * ARC_MINUTES:.3g}") for name, size in sizes.items() if math.isfinite(size)]
        for cause in Cause:
            if (alarm := self._alarms.get((row.name, cause))) and alarm.is_active:
                values.append((f"alarm {cause.value}", f"{alarm.severity.value}, {alarm.state.value}"))
        return Status(level, f"{NODE}: {row.name}", row.reason or row.health.value, self._robot, tuple(values))


def encode(statuses: Sequence[Status], time: datetime) -> bytes:
    """A DiagnosticArray in CDR, with its encapsulation header."""
    seconds, fraction = divmod(micros(time), 1_000_000)
    cdr = CdrWriter()
    cdr.number("i", seconds)
    cdr.number("I", fraction * 1000)
    cdr.text("")
    cdr.number("I", len(statuses))
    for status in statuses:
        cdr.number("B", status.level)
        for text in (status.name, status.message, status.hardware_id):
            cdr.text(text)
        cdr.number("I", len(status.values))
        for pair in status.values:
            for text in pair:
                cdr.text(text)
    return cdr.data


def key(domain: int) -> str:
    """The key under which subscribers of /diagnostics listen."""
    return rmw_zenoh.data_key(domain, TOPIC, TYPE, HASH)


def tokens(domain: int, robot: str, session: str) -> list[str]:
    """The liveliness tokens that show a node /<robot>/lostmotion, and its publisher, to ROS."""
    return rmw_zenoh.tokens(domain, session, robot, NODE, TOPIC, TYPE, HASH)
