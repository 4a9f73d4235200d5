"""Driver of CiA 402 drives on a CANopen bus with another master: it listens to SYNC and PDOs.

Nothing is ever sent, unless ``sdo`` lets a drive's mapping and units be read, by SDO uploads when the bus is opened.
``canopen_drive.py`` decodes frames, ``canopen_mapping.py`` finds the mapping, ``can_port.py`` has the bus.  An
accelerometer with the process value of CiA 404 in a PDO is received in the same way.
"""

from __future__ import annotations

import math
import time
from collections import Counter
from collections.abc import Sequence

from lostmotion.drivers.base import (
    Accelerometer,
    AccelerometerOptions,
    Driver,
    Identity,
    JointOptions,
    RobotOptions,
    ServoBus,
    ServoReading,
    ServoSample,
)
from lostmotion.drivers.can_accelerometer import CanAccelerometer, Layout
from lostmotion.drivers.can_bus import CanFrame
from lostmotion.drivers.can_port import CanPort
from lostmotion.drivers.canopen_drive import Drive
from lostmotion.drivers.canopen_mapping import Ask, given_pdos
from lostmotion.drivers.canopen_options import CanopenJointOptions, CanopenSensorOptions
from lostmotion.drivers.clock import Clock
from lostmotion.drivers.codec import sdo
from lostmotion.drivers.codec.cia301 import SYNC
from lostmotion.drivers.codec.pdo import fields_of
from lostmotion.drivers.errors import DriverError, IdentityError
from lostmotion.drivers.servo_line import silence_s

__all__ = ["DRIVER", "CanopenBus"]

GATHER_S = 0.095
"""frames of so many seconds are looked at together; the kernel keeps some 270 of a socket that is not read"""
WAIT_S = 0.2
LISTEN_S = 1.6
"""heartbeats come once a second"""
SDO_S = 0.3
"""how long a node may take to answer"""
STAYS_S = 2.0
"""a drive's state that keeps it from being measured is reported when it has lasted so long"""


class CanopenBus:
    """All drives on one bus; see ``base.ServoBus``."""

    def __init__(self, joints: Sequence[CanopenJointOptions], clock: Clock) -> None:
        """Raises DriverError for a node used twice, no mapping, or no units."""
        _check(joints)
        self._clock = clock
        self._port = CanPort(joints[0], clock.now)
        self._drives = [Drive(joint) for joint in joints]
        self._counter: int | None = None
        self._reported: dict[str, str] = {}
        self._since: dict[str, float] = {}
        self._find()

    def open(self) -> None:
        """Takes the bus, and asks the drives that may be asked.  Raises PortError."""
        for drive in self._drives:
            drive.forget()
        self._counter = None
        self._reported, self._since = {}, {}
        self._port.only(None)
        self._port.open()
        self._learn()

    def identify(self) -> tuple[Identity, ...]:
        """Listens to the drives, and asks those once more that did not answer.  Raises PortError."""
        self._port.only(None)
        wrong = self._learn()
        nodes, end = Counter[int](), self._clock.now() + LISTEN_S
        while (left := end - self._clock.now()) > 0 and not all(self._is_clear(drive) for drive in self._drives):
            for frame in self._port.read(min(left, WAIT_S)):
                nodes[frame.id & 0x7F] += 1
                self._receive(frame, [])
        self._port.only({SYNC, *self._by_id})
        now = self._clock.now()
        self._reported = {drive.joint: drive.problem(now) for drive in self._drives}
        return tuple(self._identity(drive, wrong.get(drive.joint, ""), sorted(nodes)) for drive in self._drives)

    def read(self) -> ServoReading:
        """The samples of the drives in the next 95 ms.

        Raises PortError, and IdentityError when a drive has got into, or out of, a state in which it cannot be
        measured: ``identify`` reports which.
        """
        samples: list[ServoSample] = []
        lost = 0
        if self._port.stamped:
            time.sleep(GATHER_S)
            frames = self._port.read(WAIT_S)
        else:
            frames = self._chunks()
        for frame in frames:
            lost += self._receive(frame, samples)
        samples.sort(key=lambda sample: sample.time)
        missed = sum(drive.lost for drive in self._drives)
        for drive in self._drives:
            drive.lost = 0
        broken, self._port.broken = self._port.broken, 0
        self._watch()
        return ServoReading(tuple(samples), self._silent(), max(missed, lost), broken)

    def close(self) -> None:
        """Gives the bus back."""
        self._port.close()

    def _learn(self) -> dict[str, str]:
        """Asks the drives that may be asked; why their answers are of no use, "" for those that are."""
        wrong = {drive.joint: drive.learn(self._asker(drive.node)) for drive in self._drives if drive.options.sdo}
        self._find()
        return wrong

    def _find(self) -> None:
        """Which drive sends an identifier; the coarsest step of the commands [rad], NaN before the drives report it."""
        self.resolution_rad = max(abs(drive.units.step) if drive.units else math.nan for drive in self._drives)
        self._by_id: dict[int, list[Drive]] = {}
        for drive in self._drives:
            for id in drive.ids:
                self._by_id.setdefault(id, []).append(drive)

    def _chunks(self) -> list[CanFrame]:
        """Frames that have no time of their own are fetched as they come."""
        frames: list[CanFrame] = []
        end = self._clock.now() + GATHER_S
        while (left := end - self._clock.now()) > 0:
            frames += self._port.read(left)
        return frames

    def _receive(self, frame: CanFrame, samples: list[ServoSample]) -> int:
        """Takes a frame; how many SYNCs were lost before it, where these carry a counter."""
        if frame.id == SYNC:
            return self._sync(frame.data)
        for drive in self._by_id.get(frame.id, ()):
            samples.extend(drive.take(frame))
        return 0

    def _sync(self, data: bytes) -> int:
        """The counter runs from 1 to a number of the master's (0x1019) and over; where it jumps back to 1 the missing
        ones before it are not known."""
        if len(data) != 1:
            return 0
        before, self._counter = self._counter, data[0]
        return 0 if before is None or data[0] <= before else data[0] - before - 1

    def _is_clear(self, drive: Drive) -> bool:
        return drive.complete and not drive.problem(self._clock.now())

    def _watch(self) -> None:
        """Raises IdentityError when a drive's trouble has begun, has changed or has gone for a while."""
        now = self._clock.now()
        for drive in self._drives:
            problem = drive.problem(now)
            if problem == self._reported.get(drive.joint, ""):
                self._since.pop(drive.joint, None)
            elif now - self._since.setdefault(drive.joint, now) > STAYS_S:
                raise IdentityError(f"{drive.joint}: node {drive.node}: {problem or 'its trouble is over'}")

    def _silent(self) -> tuple[str, ...]:
        now = self._clock.now()
        return tuple(drive.joint for drive in self._drives if now - drive.last_seen > silence_s(drive.options.poll_hz))

    def _asker(self, node: int) -> Ask:
        """Asks a node by SDO, one object after the other; a node that is silent once is not asked again."""
        gone = False

        def ask(index: int, subindex: int) -> int | None:
            nonlocal gone
            if gone:
                return None
            self._port.send(sdo.REQUEST + node, sdo.upload_request(index, subindex))
            end = self._clock.now() + SDO_S
            while (left := end - self._clock.now()) > 0:
                for frame in self._port.read(left):
                    if frame.id != sdo.RESPONSE + node:
                        self._receive(frame, [])
                        continue
                    try:
                        if (value := sdo.uploaded(index, subindex, frame.data)) is not None:
                            return value
                    except sdo.Abort:
                        return None
            gone = True
            return None

        return ask

    def _identity(self, drive: Drive, wrong: str, nodes: Sequence[int]) -> Identity:
        expected = f"node {drive.node}: {drive.where}"
        problem = wrong or drive.problem(self._clock.now())
        if self._port.foreign and not nodes:
            found, gist = self._port.foreign_words()
            return Identity(drive.joint, found, expected, False, gist)
        if not problem and not drive.complete:
            others = ", ".join(str(node) for node in nodes if node) or "none"
            cause = "another node, mapping or bitrate, or it is off"
            problem = f"no frames received (nodes seen: {others}); likely cause: {cause}"
        if problem:
            return Identity(drive.joint, f"node {drive.node}: {problem}", expected, False)
        facts = drive.facts
        if facts is None or facts.vendor is None:
            return Identity(drive.joint, expected, expected, True)
        who = f"CiA 402 drive, vendor 0x{facts.vendor:X}, product 0x{facts.product or 0:X}"
        return Identity(drive.joint, f"{expected}, {who}", expected, True)


def _check(joints: Sequence[CanopenJointOptions]) -> None:
    seen: dict[int, str] = {}
    for joint in joints:
        if joint.node in seen:
            raise DriverError(f"joints {seen[joint.node]} and {joint.name} have the same node {joint.node}")
        seen[joint.node] = joint.name


def _make(joints: Sequence[JointOptions], robot: RobotOptions, clock: Clock) -> ServoBus:
    return CanopenBus([joint for joint in joints if isinstance(joint, CanopenJointOptions)], clock)


def _make_sensor(options: AccelerometerOptions, robot: RobotOptions, clock: Clock) -> Accelerometer:
    assert isinstance(options, CanopenSensorOptions)
    pdos = given_pdos(options)
    if pdos is None:
        raise DriverError(f"accelerometer {options.name}: no PDO mapping; expected pdo = [...] or eds = a file")
    wanted = (options.object, options.subindex)
    for id, entries in pdos.items():
        if (field := fields_of(entries, [wanted]).get(wanted)) is not None:
            layout = Layout(id, field.shift, field.bits, True, "<", field.ends, options.scale)
            return CanAccelerometer(options, layout, None, options.range_ms2, clock)
    raise DriverError(
        f"accelerometer {options.name}: no PDO of node {options.node} holds 0x{options.object:X}:{options.subindex}"
    )


DRIVER = Driver(
    name="canopen",
    summary="CiA 402 drives and CiA 404 sensors by their PDOs, listening only",
    servo=_make,
    accelerometer=_make_sensor,
    joint_options=CanopenJointOptions,
    accelerometer_options=CanopenSensorOptions,
    shares=True,
)
