"""CANopen frames (CiA 301): EMCY objects of alarms, a TPDO of each joint's state, heartbeats, as bytes.  No I/O, no
clock.

EMCY, COB-ID 0x80 + node, 8 bytes, little-endian: error code (u16), error register (u8), then five of the vendor's:
joint index (u8, in the order of the configuration), score x 10 (u16), play in arc-minutes x 10 (u16); 0xFFFF is
unknown, 0xFFFE that or more. TPDO1, COB-ID 0x180 + node, 6 bytes: joint index (u8), health (u8, 0 OK to 3 ERROR),
severity and play in arc-minutes x 10 (u16 each) of the last window. Heartbeat, COB-ID 0x700 + node: one byte, the NMT
state. ``lostmotion.dbc`` has it too; ``node.py`` has its answers.
"""

from __future__ import annotations

import math
import struct
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

from lostmotion.daemon.records import AlarmEvent, AlarmRow, Cause, Health, ScoreRow, Severity, Transition
from lostmotion.drivers.codec.cia301 import EMCY, HEARTBEAT, OPERATIONAL, TPDO1
from lostmotion.drivers.units import ARC_MINUTES

__all__ = ["EmcyNode", "Frame"]

CLEARED, PLAY_WARNING, PLAY_ERROR, DEVICE_FAULT = 0x0000, 0xFF01, 0xFF02, 0xFF03
REGISTER = 0x81
"""object 0x1001 while an error stands: generic (bit 0), manufacturer specific (bit 7)"""
LAYOUT, STATE_LAYOUT = struct.Struct("<HBBHH"), struct.Struct("<BBHH")
HEALTHS = {health: number for number, health in enumerate(Health)}
ALL_JOINTS = 0xFF
UNKNOWN, MOST = 0xFFFF, 0xFFFE
HISTORY = 8
"""errors that object 0x1003 holds"""


@dataclass(frozen=True, slots=True)
class Frame:
    """A frame with an 11-bit identifier."""

    cob_id: int
    data: bytes


class EmcyNode:
    """One node's frames about its joints' alarms and states.  A DEGRADED alarm has no code: it counts as no error
    here.

    history: the newest errors first, each as its code and the joint's index; last_state: the last content of TPDO1.
    """

    def __init__(self, node_id: int, joints: Sequence[str]) -> None:
        self._node = node_id
        self._index = {joint: index for index, joint in enumerate(joints)}
        self._scores: dict[str, ScoreRow] = {}
        self._healths: dict[str, Health] = {}
        self._standing: dict[tuple[str, Cause], int] = {}
        self.history: deque[tuple[int, int]] = deque(maxlen=HISTORY)
        self.last_state = STATE_LAYOUT.pack(ALL_JOINTS, 0, UNKNOWN, UNKNOWN)

    @property
    def register(self) -> int:
        """Object 0x1001."""
        return REGISTER if self._standing else 0

    def score(self, row: ScoreRow) -> None:
        """Sets the figures of the joint's next frame."""
        self._scores[row.joint] = row

    def health(self, joint: str, health: Health) -> None:
        """Sets the health in the joint's next state."""
        self._healths[joint] = health

    def state(self, joint: str) -> list[Frame]:
        """TPDO1 of a joint; none of one that is not in the configuration."""
        if joint not in self._index:
            return []
        last = self._scores.get(joint)
        sizes = (last.severity, last.play) if last else (math.nan, math.nan)
        severity, play = (_tenths(size * ARC_MINUTES) for size in sizes)
        health = HEALTHS[self._healths.get(joint, Health.OK)]
        self.last_state = STATE_LAYOUT.pack(self._index[joint], health, severity, play)
        return [Frame(TPDO1 + self._node, self.last_state)]

    def states(self) -> list[str]:
        """The joints of which something is known."""
        return [joint for joint in self._index if joint in self._scores or joint in self._healths]

    def alarm(self, transition: Transition) -> list[Frame]:
        """The frames that a transition calls for.

        An error that goes, or becomes another code, while others stand is "error reset" with the register of those that
        stand; they are sent again, since many a consumer forgets all errors at a reset.  Without the reset a consumer
        would keep the code that was.
        """
        alarm = transition.alarm
        key, code = (alarm.joint, alarm.cause), _code(alarm)
        if alarm.joint not in self._index or self._standing.get(key, CLEARED) == code:
            return [self._emcy(code, alarm.joint)] if transition.event is AlarmEvent.REMINDED and code else []
        if code:
            self.history.appendleft((code, self._index[alarm.joint]))
        if key not in self._standing:
            self._standing[key] = code
            return [self._emcy(code, alarm.joint)]
        del self._standing[key]
        if code:
            self._standing[key] = code
        return [self._emcy(CLEARED, alarm.joint), *self._errors()]

    def everything(self) -> list[Frame]:
        """For a bus that has missed something: a reset, then every error that stands."""
        return [self._emcy(CLEARED, None), *self._errors()]

    def heartbeat(self, state: int = OPERATIONAL) -> Frame:
        """The heartbeat (error control)."""
        return Frame(HEARTBEAT + self._node, bytes([state]))

    def _errors(self) -> list[Frame]:
        return [self._emcy(code, joint) for (joint, _), code in self._standing.items()]

    def _emcy(self, code: int, joint: str | None) -> Frame:
        last = self._scores.get(joint or "")
        index = ALL_JOINTS if joint is None else self._index[joint]
        score, play = (_tenths(last.score), _tenths(last.play * ARC_MINUTES)) if last else (UNKNOWN, UNKNOWN)
        return Frame(EMCY + self._node, LAYOUT.pack(code, self.register, index, score, play))


def _code(alarm: AlarmRow) -> int:
    if not alarm.is_active or alarm.severity is Severity.DEGRADED:
        return CLEARED
    if alarm.cause is Cause.DEVICE:
        return DEVICE_FAULT
    return PLAY_ERROR if alarm.severity is Severity.ERROR else PLAY_WARNING


def _tenths(value: float) -> int:
    return min(max(round(value * 10), 0), MOST) if math.isfinite(value) else UNKNOWN
