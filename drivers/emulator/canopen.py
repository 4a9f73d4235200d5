"""A CANopen bus behind a serial adapter (slcan): a master, CiA 402 drives and a CiA 404 sensor, frame for frame.

The same frames, without the adapter, go out on any other bus by ``frames``.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from struct import pack

from lostmotion.drivers.codec import slcan
from lostmotion.drivers.codec.cia301 import HEARTBEAT, OPERATIONAL, RPDO1, SYNC, TPDO1, TPDO2
from lostmotion.drivers.codec.sdo import NO_OBJECT, READ_ONLY, REQUEST, RESPONSE, Abort, SdoServer
from lostmotion.drivers.emulator.motion import SPREAD_S, Motion

__all__ = ["COUNTS", "RATIO", "SENSOR_SCALE", "CanopenLine", "VirtualDrive"]

COUNTS, RATIO = 10_000, 50
"""of a turn of the motor; turns of the motor for one of the joint"""
STEP = math.tau / (COUNTS * RATIO)
RATED_TORQUE_MNM, RATED_CURRENT_MA = 500, 4000
SENSOR_SCALE = 0.005
"""m/s² a unit of the sensor's process value"""
SYNC_OVERFLOW = 240
ENABLED = 0x0637
"""status word"""
PERIOD_S, SENSOR_HZ = 0.01, 1000.0
"""from SYNC to SYNC; samples a second of the sensor"""
AWAKE_S = 1.0
BEAT_S = 1.0
Frame = tuple[int, bytes]


class VirtualDrive:
    """One drive; statusword, nmt and silent may be set, to put it into trouble."""

    def __init__(self, node: int, motion: Motion, ahead: float = 0.0) -> None:
        self.node = node
        self.statusword = ENABLED
        self.nmt = OPERATIONAL
        self.silent = False
        self._motion, self._ahead = motion, ahead
        self.server = SdoServer(self._read, self._refuse)

    def target(self, now: float) -> int:
        """The target position [counts] that the master sends at a time [s]."""
        return round(self._motion.goal(now + self._ahead) / STEP)

    def cycle(self, now: float) -> Iterable[Frame]:
        """What follows a SYNC: the master's RPDO, the drive's TPDOs."""
        yield RPDO1 + self.node, pack("<Hi", 0x000F, self.target(now))
        if self.silent or self.nmt != OPERATIONAL:
            return
        speed = self._motion.velocity(now + self._ahead)
        position = round(self._motion.position(now + self._ahead) / STEP)
        yield TPDO1 + self.node, pack("<Hi", self.statusword, position)
        yield TPDO2 + self.node, pack("<ihh", round(speed / STEP), round(100 * speed), round(50 * speed))

    def objects(self) -> dict[tuple[int, int], bytes]:
        """Its object dictionary, as far as a listener asks for it."""
        node = self.node
        return {
            (0x1000, 0): pack("<I", 402 | 2 << 16),
            (0x1018, 1): pack("<I", 0x1234),
            (0x1018, 2): pack("<I", 0x5678),
            (0x1400, 1): pack("<I", RPDO1 + node),
            (0x1600, 0): b"\2",
            (0x1600, 1): pack("<I", 0x60400010),
            (0x1600, 2): pack("<I", 0x607A0020),
            (0x1800, 1): pack("<I", 0x40000000 | TPDO1 + node),
            (0x1A00, 0): b"\2",
            (0x1A00, 1): pack("<I", 0x60410010),
            (0x1A00, 2): pack("<I", 0x60640020),
            (0x1801, 1): pack("<I", TPDO2 + node),
            (0x1A01, 0): b"\3",
            (0x1A01, 1): pack("<I", 0x606C0020),
            (0x1A01, 2): pack("<I", 0x60770010),
            (0x1A01, 3): pack("<I", 0x60780010),
            (0x1802, 1): pack("<I", 0x80000380 + node),
            (0x6075, 0): pack("<I", RATED_CURRENT_MA),
            (0x6076, 0): pack("<I", RATED_TORQUE_MNM),
            (0x608F, 1): pack("<I", COUNTS),
            (0x608F, 2): pack("<I", 1),
            (0x6091, 1): pack("<I", RATIO),
            (0x6091, 2): pack("<I", 1),
        }

    def _read(self, index: int, subindex: int) -> bytes:
        try:
            return self.objects()[index, subindex]
        except KeyError:
            raise Abort(NO_OBJECT) from None

    def _refuse(self, index: int, subindex: int, data: bytes) -> None:
        raise Abort(READ_ONLY)


class CanopenLine:
    """Drives of the nodes, each a motion later than the next, with SYNC and its counter; a CiA 404 sensor where
    ``sensor`` is a node, with 16 bits in its TPDO1.

    received: the frames that were sent to the bus by whoever listens; lose: so many SYNCs with all that follows them
    get lost from now on.
    """

    def __init__(self, nodes: Sequence[int], motion: Motion, sensor: int = 0) -> None:
        last = len(nodes) - 1
        self.drives = {node: VirtualDrive(node, motion, SPREAD_S * (last - i)) for i, node in enumerate(nodes)}
        self.received: list[Frame] = []
        self.commands: list[bytes] = []
        self.lose = 0
        self._sensor = sensor
        tip = motion.tip(SENSOR_HZ) / SENSOR_SCALE if sensor else ()
        self._tip = [pack("<h", max(-32768, min(32767, round(value)))) for value in tip]
        self._count = 0
        self._cycle = self._sample = 0
        self._due = -math.inf
        self._beat = 0.0
        self._open = False
        self._text = b""
        self._answers: list[Frame] = []

    def receive(self, data: bytes, now: float) -> None:
        """Commands to the adapter, and frames for the bus."""
        *lines, self._text = (self._text + data).split(b"\r")
        for line in lines:
            frames = slcan.SlcanDecoder().feed(line + b"\r")
            if not frames:
                self.commands.append(line)
                self._open = line in (b"O", b"L") or (self._open and line != b"C")
            for id, content in frames:
                self.receive_frame(id, content)

    def receive_frame(self, id: int, data: bytes) -> None:
        """Takes a frame from the host."""
        self.received.append((id, data))
        drive = self.drives.get(id - REQUEST)
        if drive and not drive.silent and (answer := drive.server.answer(data)):
            self._answers.append((RESPONSE + drive.node, answer))

    def due(self) -> float:
        """When the next frames go out [s]."""
        return -math.inf if self._answers else self._due

    def emit(self, now: float) -> bytes:
        """All bytes of the adapter up to now."""
        data = b"".join([slcan.encode(id, data) for id, data in self.frames(now)])
        return data if self._open else b""

    def frames(self, now: float) -> list[Frame]:
        """All frames on the bus up to now."""
        answers, self._answers = self._answers, []
        if self._due < now - AWAKE_S:  # switched on just now
            self._cycle, self._sample = int(now / PERIOD_S), int(now * SENSOR_HZ)
        sent = list(answers)
        while self._cycle * PERIOD_S <= now:
            sent += self._one_cycle(self._cycle * PERIOD_S)
            self._cycle += 1
        if self._sensor:
            end = int(now * SENSOR_HZ) + 1
            sent += [(TPDO1 + self._sensor, self._tip[i % len(self._tip)]) for i in range(self._sample, end)]
            self._sample = max(self._sample, end)
        if now > self._beat + BEAT_S:
            self._beat = now
            sent += [(HEARTBEAT + d.node, bytes([d.nmt])) for d in self.drives.values() if not d.silent]
        self._due = min(self._cycle * PERIOD_S, now + 0.005) if self._sensor else self._cycle * PERIOD_S
        return sent

    def _one_cycle(self, time: float) -> list[Frame]:
        self._count = self._count % SYNC_OVERFLOW + 1
        if self.lose:
            self.lose -= 1
            return []
        sent: list[Frame] = [(SYNC, bytes([self._count]))]
        for drive in self.drives.values():
            sent += drive.cycle(time)
        return sent
