"""CAN as a sink: a thread that owns the bus, sends heartbeats and what ``emcy.py`` makes of alarms and states, and what
``node.py`` answers.

The caller never waits for the bus.  Whatever goes wrong there (adapter unplugged, bus off, nobody acknowledges, queue
full) has one answer: close it, open it again after a pause, and send every active error again.
"""

from __future__ import annotations

import logging
import threading
import time
from collections import deque
from collections.abc import Sequence
from typing import Any

from lostmotion.daemon.no_memory import NO_MEMORY, retry_without_memory
from lostmotion.daemon.options import CanOptions
from lostmotion.daemon.records import JointRow, ScoreRow, Transition
from lostmotion.daemon.repeats import Condition, Repeats
from lostmotion.daemon.sinks.emcy import EmcyNode, Frame
from lostmotion.daemon.sinks.node import Node
from lostmotion.daemon.sinks.wakeup import Wakeup
from lostmotion.drivers.codec.cia301 import BOOT_UP, HEARTBEAT, NMT, OPERATIONAL, STOPPED
from lostmotion.drivers.codec.sdo import REQUEST
from lostmotion.drivers.python_can import FAULTS, can

__all__ = ["CanSink", "open_bus"]

log = logging.getLogger(__name__)

FIRST_RETRY_S = 1.0
LAST_RETRY_S = 30.0
SEND_S = 0.5
"""how long a frame may wait for room in the adapter [s]"""
CLOSE_S = 2.0
WAITING = 256
"""frames that wait at most; more are replaced by the present state"""
REST_S = 0.2
"""after states it rests so long before the next ones, of all joints together [s]: each wait costs more than what is
sent; alarms are sent at once"""
IN_KERNEL = "socketcan"
LISTEN_S = 0.1
"""how long an interface without a file descriptor is listened to before what has come up is sent [s]"""
READ_AT_ONCE = 1000
"""frames that are looked at before it is sent on a bus that floods the node"""


class CanSink:
    """Sends one node's alarms, and the newest state of each joint.

    joints: all of the robot, whose order gives their indices on the bus.
    """

    def __init__(self, joints: Sequence[str], options: CanOptions) -> None:
        self._options = options
        self._node = EmcyNode(options.node_id, joints)
        self._services = Node(self._node, options.node_id, options.heartbeat_s)
        self._waiting: deque[Frame] = deque()
        self._changed: dict[str, None] = {}
        self._rests, self._rest_ends = False, 0.0
        self._lock = threading.Lock()
        self._wakeup = Wakeup()
        self._closing = threading.Event()
        self._condition, self._warned = Condition(), Repeats()
        self.problem = "not open yet"
        self._thread = threading.Thread(target=retry_without_memory, args=(self._run, "CAN"), name="can", daemon=True)
        self._thread.start()

    def score(self, row: ScoreRow) -> None:
        with self._lock:
            self._node.score(row)
            self._has_changed(row.joint)

    def alarm(self, transition: Transition, again: bool = False) -> None:
        with self._lock:
            self._waiting.extend(self._node.alarm(transition))
            if len(self._waiting) > WAITING:
                self._waiting = deque(self._node.everything())
        self._wakeup.wake()

    def health(self, row: JointRow) -> None:
        with self._lock:
            self._node.health(row.name, row.health)
            self._has_changed(row.name)

    def close(self) -> None:
        """Sends what is waiting, and leaves the bus.  A bus that hangs is left hanging."""
        self._closing.set()
        self._wakeup.wake()
        self._thread.join(CLOSE_S)

    def _run(self) -> None:
        pause = FIRST_RETRY_S
        while not self._closing.is_set():
            try:
                with open_bus(self._options) as bus:
                    self._begin(bus)
                    pause = FIRST_RETRY_S
                    self._serve(bus)
            except (*FAULTS, MemoryError) as error:  # the thread goes on after a lack of memory, too
                self._log_problem(NO_MEMORY if isinstance(error, MemoryError) else str(error) or type(error).__name__)
            self._closing.wait(pause)
            pause = min(2 * pause, LAST_RETRY_S)

    def _begin(self, bus: can.BusABC) -> None:
        """Sends boot-up and the complete present state, whatever was sent before.  A boot-up ends whatever a master had
        commanded."""
        with self._lock:
            self._services.state = OPERATIONAL
            self._waiting = deque([self._node.heartbeat(BOOT_UP), *self._node.everything()])
            self._changed, self._rests = dict.fromkeys(self._node.states()), False
        self._send_waiting(bus)
        self._log_problem("")

    def _serve(self, bus: can.BusABC) -> None:
        beat = 0.0
        while not self._closing.is_set():
            if time.monotonic() >= beat:
                beat = time.monotonic() + self._options.heartbeat_s
                _send(bus, self._node.heartbeat(self._services.state))
            until = min(beat, self._rest_ends) if self._rests else beat
            self._listen(bus, max(until - time.monotonic(), 0.0))
            self._send_waiting(bus)

    def _listen(self, bus: can.BusABC, seconds: float) -> None:
        """Waits to be woken or for the bus, and answers what has come in; whoever reads an adapter also keeps it
        sending."""
        descriptor = _descriptor(bus)
        if descriptor is None:
            seconds = min(seconds, LISTEN_S)
        else:
            if not self._wakeup.wait(seconds, descriptor):
                return
            seconds = 0.0
        for _ in range(READ_AT_ONCE):
            try:
                message = bus.recv(seconds)
            except NotImplementedError:  # an interface that only sends
                self._wakeup.wait(seconds)
                return
            if message is None:
                return
            seconds = 0.0
            if not (message.is_error_frame or message.is_remote_frame or message.is_extended_id):
                self._answer(bus, message)

    def _answer(self, bus: can.BusABC, message: can.Message) -> None:
        if message.arbitration_id == HEARTBEAT + self._options.node_id:
            self._warn_of_another()
            return
        with self._lock:
            frames, anew = self._services.receive(message.arbitration_id, bytes(message.data))
            if anew:
                self._changed = dict.fromkeys(self._node.states())
        for frame in frames:
            _send(bus, frame)

    def _send_waiting(self, bus: can.BusABC) -> None:
        while frames := self._next():
            for frame in frames:
                _send(bus, frame)

    def _next(self) -> Sequence[Frame]:
        """What has waited longest, alarms before states; a stopped node sends its present state when it is started."""
        with self._lock:
            if self._services.state == STOPPED:
                self._waiting.clear()
            if self._waiting:
                return [self._waiting.popleft()]
            now = time.monotonic()
            if self._rests and now < self._rest_ends:
                return []
            self._rests = False
            if self._services.state != OPERATIONAL:
                return []
            frames = [frame for joint in self._changed for frame in self._node.state(joint)]
            self._changed = {}
            self._rests, self._rest_ends = bool(frames), now + REST_S
            return frames

    def _has_changed(self, joint: str) -> None:
        """Only the newest state of a joint waits, so that many scores are no flood."""
        self._changed[joint] = None
        if not self._rests:
            self._wakeup.wake()

    def _warn_of_another(self) -> None:
        """A heartbeat of this number is another device's: a bus gives back none of our own frames, unless asked to; a
        multicast group does."""
        if self._options.options.get("receive_own_messages") or self._options.interface == "udp_multicast":
            return
        problem = (
            f"another device sends heartbeats as node 0x{self._options.node_id:02X}; give one of them another number"
        )
        if self._warned.is_news(problem, time.monotonic()):
            log.warning("CAN %s %s: %s", self._options.interface, self._options.channel, problem)

    def _log_problem(self, problem: str) -> None:
        """Logs when the bus begins to fail and when it works again, not every time: one without another node opens
        and fails every few seconds."""
        self.problem = problem
        if not self._condition.is_news("fails" if problem else "", time.monotonic()):
            return
        name = f"CAN {self._options.interface} {self._options.channel}"
        if problem:
            log.warning("%s: %s; trying again, active alarms are sent then", name, problem)
        else:
            log.info("%s: open, node 0x%02X", name, self._options.node_id)


def open_bus(options: CanOptions) -> can.BusABC:
    """The bus.  The kernel lets in NMT commands, questions to the node and heartbeats of its number; python-can's own
    filter, of the other interfaces, is none that saves anything.  Raises one of ``FAULTS``."""
    given: dict[str, Any] = {"bitrate": options.bitrate} if options.bitrate else {}
    if options.interface == IN_KERNEL:
        ids = (NMT, REQUEST + options.node_id, HEARTBEAT + options.node_id)
        given["can_filters"] = [{"can_id": id, "can_mask": 0x7FF, "extended": False} for id in ids]
    return can.Bus(options.channel, interface=options.interface, **(given | options.options))


def _descriptor(bus: can.BusABC) -> int | None:
    """What becomes readable with a frame, of an interface that has such a thing."""
    try:
        return bus.fileno()
    except NotImplementedError:
        return None


def _send(bus: can.BusABC, frame: Frame) -> None:
    bus.send(can.Message(arbitration_id=frame.cob_id, data=frame.data, is_extended_id=False), timeout=SEND_S)
