"""Driver of a second adapter on a servos' line that has another master: it listens, and never sends a byte.

The commands are the goals that the master writes, the positions what it reads.  The bytes are decoded by
``codec/sniffer.py`` and ``codec/registers.py``; the port in ``listening_port.py``.  Dynamixel of both protocols and
Feetech, also mixed on one line.
"""

from __future__ import annotations

import math
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field

from lostmotion.drivers.base import Driver, Identity, JointOptions, RobotOptions, ServoBus, ServoReading, ServoSample
from lostmotion.drivers.clock import Clock, next_cycle
from lostmotion.drivers.codec.registers import ALL_MODELS, Registers
from lostmotion.drivers.codec.servo_state import POSITION
from lostmotion.drivers.codec.sniffer import AccessKind, BusSniffer, RegisterAccess
from lostmotion.drivers.listening_port import ListeningPort
from lostmotion.drivers.servo_line import LineOptions, check_line, silence_s

__all__ = ["DRIVER", "TapBus", "TapOptions"]

HOLD_S = 2e-3
"""what comes within so long of a first byte is fetched together: a question with its answers takes 1 to 3 ms, and each
fetch costs a wake-up"""
LISTEN_S = 1.6
"""long enough for a master that reads once a second"""
SHOWN = 24
"""so many bytes of what is no packet are shown"""


class TapOptions(LineOptions, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Keys of a joint that is listened to; poll_hz: how often its master reads the position.  See
    ``servo_line.LineOptions``."""


@dataclass(slots=True, eq=False)
class _Servo:
    """A monitored servo; last_seen: time of its last position [s]; counts: register accesses since ``open``."""

    options: TapOptions
    registers: Registers
    last_seen: float = -math.inf
    counts: Counter[AccessKind] = field(default_factory=Counter)
    positions: int = 0
    asked: set[int] = field(default_factory=set)


class TapBus:
    """All joints on one line; see ``base.ServoBus``.

    A sample is made of each position that is answered.  Its time is that at which the bytes began to come in, some ms
    after the request: as late as the adapter delivers them (16 ms of an FTDI adapter as shipped).
    """

    def __init__(self, joints: Sequence[TapOptions], clock: Clock) -> None:
        """Raises DriverError for an unknown model, an id used twice or different baud rates."""
        check_line(joints, ALL_MODELS)
        self._clock = clock
        self._joints = joints
        self._port = ListeningPort(joints[0].port, joints[0].baudrate)
        models = {joint.name: ALL_MODELS[joint.model] for joint in joints}
        self._streams = [BusSniffer(protocol) for protocol in sorted({model.protocol for model in models.values()})]
        self.resolution_rad = max(model.step for model in models.values())
        self._servos: dict[int, _Servo] = {}
        self._broken, self._first = 0, b""
        self._forget()

    def open(self) -> None:
        """Takes the port.  Raises PortError."""
        self._port.open()
        self._forget()

    def identify(self) -> tuple[Identity, ...]:
        """Listens for traffic of each servo.  Raises PortError."""
        self._forget()
        self._listen(LISTEN_S)
        return tuple(self._identity(servo) for servo in self._servos.values())

    def read(self) -> ServoReading:
        """The samples until the next cycle begins.  Raises PortError."""
        now = self._clock.now()
        samples = self._listen(next_cycle(now, self._clock.cycle_s) - now)
        broken, self._broken = self._broken, self._damage()
        return ServoReading(tuple(samples), self._silent(), broken=self._broken - broken)

    def close(self) -> None:
        """Gives the port back."""
        self._port.close()

    def _forget(self) -> None:
        for stream in self._streams:
            stream.reset()
        self._servos = {joint.id: _Servo(joint, Registers(ALL_MODELS[joint.model])) for joint in self._joints}
        self._broken, self._first = self._damage(), b""

    def _listen(self, seconds: float) -> list[ServoSample]:
        """Gathers what comes in for so long, and then looks at it: looking takes longest right after a wait."""
        pieces: list[tuple[float, bytes]] = []
        end = self._clock.now() + seconds
        while (left := end - self._clock.now()) > 0:
            if self._port.wait(left):
                begun = self._clock.now()
                time.sleep(HOLD_S)
                pieces.append((begun, self._port.read(0.0)))
        samples: list[ServoSample] = []
        for begun, data in pieces:
            self._first = self._first or data[:SHOWN]
            for stream in self._streams:
                for access in stream.feed(data):
                    self._take(access, begun, samples)
        return samples

    def _take(self, access: RegisterAccess, now: float, samples: list[ServoSample]) -> None:
        servo = self._servos.get(access.id)
        if servo is None:
            return
        servo.counts[access.kind] += 1
        if access.kind is AccessKind.ASKED:
            servo.asked.add(access.address)
            return
        names = servo.registers.update(access.address, access.data, now)
        if access.kind is AccessKind.ANSWERED and POSITION in names and now > servo.last_seen:
            servo.last_seen = now
            servo.positions += 1
            state = servo.registers.state(now)
            samples.append(
                ServoSample(
                    servo.options.name, now, state.command, state.position, state.velocity, math.nan, state.current,
                    state.voltage, state.temperature,
                )
            )  # fmt: skip

    def _damage(self) -> int:
        """Broken frames; on a line with two protocols each takes the other's frames for noise."""
        return self._streams[0].broken if len(self._streams) == 1 else 0

    def _silent(self) -> tuple[str, ...]:
        now = self._clock.now()
        return tuple(
            servo.options.name
            for servo in self._servos.values()
            if now - servo.last_seen > silence_s(servo.options.poll_hz)
        )

    def _identity(self, servo: _Servo) -> Identity:
        options = servo.options
        expected = f"id {options.id}: positions of {options.model}"
        if not servo.positions:
            found = self._fault(servo)
            return Identity(options.name, found, expected, False, found.replace(repr(self._first), "bytes"))
        goals = (
            "goals received"
            if servo.registers.has_command
            else "no goal received: until then the command is the position"
        )
        rate = f"about {servo.positions / LISTEN_S:.2g} a second"
        return Identity(options.name, f"{expected}, {rate}, {goals}", expected, True, expected)

    def _fault(self, servo: _Servo) -> str:
        """Why no position of a servo was seen."""
        name = f"id {servo.options.id}"
        if not self._first:
            return f"{name}: nothing on the line; likely cause: its master does not run, or another wire"
        if not any(stream.is_spoken for stream in self._streams):
            return (
                f"{name}: no packets, but {self._first!r}; likely cause: another device on the port, another baudrate,"
                " or servos of another protocol"
            )
        if servo.counts[AccessKind.ANSWERED]:
            asked = ", ".join(str(address) for address in sorted(servo.asked))
            return (
                f"{name}: answers without the position, its master reads from address {asked}; likely cause: another"
                " model, or indirect addresses, which a tap cannot decode"
            )
        if servo.counts[AccessKind.ASKED]:
            return (
                f"{name}: asked, and no answer received; likely cause: it has no power, or only the master's own wire"
                " is connected"
            )
        if servo.counts[AccessKind.WRITTEN]:
            return f"{name}: goals, and no position; likely cause: its master never reads it"
        return f"{name}: no packets for it, but for other ids; likely cause: another id"


def _make(joints: Sequence[JointOptions], robot: RobotOptions, clock: Clock) -> ServoBus:
    return TapBus([joint for joint in joints if isinstance(joint, TapOptions)], clock)


DRIVER = Driver(
    name="tap",
    summary="Dynamixel and Feetech servos on a line of another master, listening only",
    servo=_make,
    joint_options=TapOptions,
)
