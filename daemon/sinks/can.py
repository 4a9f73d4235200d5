"""CAN as a sink: a thread that owns the bus, sends heartbeats and what ``emcy.py`` makes of alarms and states.

The caller never waits for the bus.  Whatever goes wrong there (adapter unplugged, bus off, nobody acknowledges, queue
full) has one answer: close it, open it again after a pause, and tell every error that stands.
"""

from __future__ import annotations

import logging
import termios
import threading
import time
from collections import deque
from collections.abc import Sequence
from contextlib import suppress

import can
from can.interfaces.slcan import slcanBus

from lostmotion.daemon.options import CanOptions
from lostmotion.daemon.records import JointRow, ScoreRow, Transition
from lostmotion.daemon.repeats import Condition
from lostmotion.daemon.sinks.emcy import BOOT_UP, EmcyNode, Frame

__all__ = ["FAULTS", "CanSink", "open_bus"]

log = logging.getLogger(__name__)

logging.getLogger("can").setLevel(logging.CRITICAL)  # what it says in its own words is said here in ours
FAULTS = (can.CanError, OSError, ValueError, TypeError, termios.error)
"""what python-can's interfaces raise for a bus that is not there, or not as it should be"""
FIRST_RETRY_S = 1.0
LAST_RETRY_S = 30.0
SEND_S = 0.5
"""how long a frame may wait for room in the adapter [s]"""
CLOSE_S = 2.0
WAITING = 256
"""frames that wait at most; more are replaced by one telling of what stands"""
READ_AT_ONCE = 1000


class CanSink:
    """Tells one node's alarms, and of each joint the newest state.

    joints: all of the robot, whose order gives their indices on the bus.
    """

    def __init__(self, joints: Sequence[str], options: CanOptions) -> None:
        self._options = options
        self._node = EmcyNode(options.node_id, joints)
        self._waiting: deque[Frame] = deque()
        self._changed: dict[str, None] = {}
        self._wake = threading.Condition()
        self._closing = False
        self._condition = Condition()
        self._thread = threading.Thread(target=self._run, name="can", daemon=True)
        self._thread.start()

    def score(self, row: ScoreRow) -> None:
        with self._wake:
            self._node.score(row)
            self._has_changed(row.joint)

    def alarm(self, transition: Transition, again: bool = False) -> None:
        with self._wake:
            self._waiting.extend(self._node.alarm(transition))
            if len(self._waiting) > WAITING:
                self._waiting = deque(self._node.everything())
            self._wake.notify()

    def health(self, row: JointRow) -> None:
        with self._wake:
            self._node.health(row.name, row.health)
            self._has_changed(row.name)

    def close(self) -> None:
        """Sends what is waiting, and leaves the bus.  A bus that hangs is left hanging."""
        with self._wake:
            self._closing = True
            self._wake.notify()
        self._thread.join(CLOSE_S)

    def _run(self) -> None:
        pause = FIRST_RETRY_S
        while not self._closing:
            try:
                with open_bus(self._options) as bus:
                    self._begin(bus)
                    pause = FIRST_RETRY_S
                    self._serve(bus)
            except FAULTS as error:
                self._say(str(error) or type(error).__name__)
            with self._wake:
                self._wake.wait_for(lambda: self._closing, pause)
            pause = min(2 * pause, LAST_RETRY_S)

    def _begin(self, bus: can.BusABC) -> None:
        """The node is there; what stands is told, whatever was told before."""
        with self._wake:
            self._waiting = deque([self._node.heartbeat(BOOT_UP), *self._node.everything()])
            self._changed = dict.fromkeys(self._node.states())
        self._send_waiting(bus)
        self._say("")

    def _serve(self, bus: can.BusABC) -> None:
        beat = 0.0
        while not self._closing:
            if time.monotonic() >= beat:
                beat = time.monotonic() + self._options.heartbeat_s
                _drain(bus)
                _send(bus, self._node.heartbeat())
            with self._wake:
                self._wake.wait_for(lambda: self._waiting or self._changed or self._closing, beat - time.monotonic())
            self._send_waiting(bus)

    def _send_waiting(self, bus: can.BusABC) -> None:
        while frames := self._next():
            for frame in frames:
                _send(bus, frame)

    def _next(self) -> Sequence[Frame]:
        """What has waited longest, alarms before states."""
        with self._wake:
            if self._waiting:
                return [self._waiting.popleft()]
            frames = [frame for joint in self._changed for frame in self._node.state(joint)]
            self._changed = {}
            return frames

    def _has_changed(self, joint: str) -> None:
        """Only the newest state of a joint waits, so that many scores are no flood."""
        self._changed[joint] = None
        self._wake.notify()

    def _say(self, problem: str) -> None:
        """Logs when the bus begins to fail and when it works again, not every time: one on which nobody answers opens
        and fails every few seconds."""
        if not self._condition.is_news("fails" if problem else "", time.monotonic()):
            return
        name = f"CAN {self._options.interface} {self._options.channel}"
        if problem:
            log.warning("%s: %s; trying again, alarms that stand are told then", name, problem)
        else:
            log.info("%s: open, node 0x%02X", name, self._options.node_id)


def open_bus(options: CanOptions) -> can.BusABC:
    """The bus, of which only NMT commands would be received.  Raises one of ``FAULTS``."""
    bitrate = {"bitrate": options.bitrate} if options.bitrate else {}
    filters: list[can.typechecking.CanFilter] = [{"can_id": 0, "can_mask": 0x7FF, "extended": False}]
    given = bitrate | options.options
    return can.Bus(options.channel, interface=options.interface, can_filters=filters, **given)  # type: ignore[arg-type]


def _send(bus: can.BusABC, frame: Frame) -> None:
    bus.send(can.Message(arbitration_id=frame.cob_id, data=frame.data, is_extended_id=False), timeout=SEND_S)


def _drain(bus: can.BusABC) -> None:
    """Throws away what came in: an adapter that nobody reads may stop to send."""
    if isinstance(bus, slcanBus):
        bus.flush()
        return
    with suppress(NotImplementedError):
        for _ in range(READ_AT_ONCE):
            if bus.recv(0.0) is None:
                return
