"""Servos on one line, byte for byte, with faults on request: Dynamixel's protocols 1.0 and 2.0.  No I/O of its own.

Feetech's servos, which differ in their control table, are in ``feetech.py``.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from struct import pack_into, unpack_from
from typing import Self

from lostmotion.drivers.codec.dynamixel import BROADCAST, PING, READ, STATUS, SYNC_READ, WRITE, Packet, decoder, encode
from lostmotion.drivers.codec.servo_state import MODELS, Model, ServoState
from lostmotion.drivers.emulator.motion import SPREAD_S, Motion

__all__ = ["ServoLine", "VirtualServo"]

ID_ADDRESS = {1: 3, 2: 7}
INSTRUCTION_ERROR = {1: 0x40, 2: 0x02}
RANGE_ERROR = {1: 0x08, 2: 0x07}
SYNC_HEADER = {1: 2, 2: 4}
"""bytes of address and length before the ids of a sync read"""


class VirtualServo:
    """One servo: its control table, moved along a motion until someone writes a goal.

    ``error`` is the error byte of all its answers; a ``silent`` servo gives none.
    """

    def __init__(self, model: Model, id: int, motion: Motion, ahead: float = 0.0) -> None:
        self.model = model
        self.id = id
        self.silent = False
        self.error = 0
        self._motion = motion
        self._ahead = ahead
        self._held: float | None = None
        self._table = bytearray(256)
        self._label()

    def hold(self, angle: float = 0.0) -> None:
        """From now on it stands at an angle [rad]."""
        self._held = angle

    def state(self, now: float) -> ServoState:
        """The state it would report at a time [s]."""
        if self._held is not None:
            return ServoState(self._held, self._held, 0.0, 11.8, 41, 0.02)
        time = now + self._ahead
        speed = self._motion.velocity(time)
        return ServoState(self._motion.goal(time), self._motion.position(time), speed, 11.8, 41, 0.1 * speed)

    def answer(self, packet: Packet, now: float) -> Packet | None:
        """The status packet for an instruction; None where a servo stays quiet."""
        if self.silent or (packet.id == BROADCAST and packet.code not in (PING, SYNC_READ)):
            return None
        if packet.code == PING:
            return self._status(b"" if self.model.protocol == 1 else bytes(self._table[0:2]) + b"\x30")
        if packet.code in (READ, SYNC_READ) and len(packet.parameters) == 2 * self.model.protocol:
            return self._status(self.read(packet.parameters, now))
        if packet.code == WRITE and len(packet.parameters) > self.model.protocol:
            return self._status(b"", self._write(packet.parameters))
        return self._status(b"", INSTRUCTION_ERROR[self.model.protocol])

    def read(self, parameters: bytes, now: float) -> bytes:
        """The bytes that an instruction's address and length ask for."""
        at = self.model.address
        self._table[at : at + self.model.block_size] = self.block(now)
        start, length = parameters if self.model.protocol == 1 else unpack_from("<HH", parameters)
        return bytes(self._table[start : start + length])

    def _label(self) -> None:
        """Puts model number and id into the control table."""
        pack_into("<H", self._table, 0, self.model.number)
        self._table[ID_ADDRESS[self.model.protocol]] = self.id

    def block(self, now: float) -> bytes:
        """Its state block at a time [s]."""
        return self.model.encode(self.state(now))

    def _goal(self, parameters: bytes) -> tuple[int, int] | None:
        """Address and goal [counts] of a write; None where it is no goal's size."""
        form, width = ("<Bh", 3) if self.model.protocol == 1 else ("<Hi", 6)
        return unpack_from(form, parameters) if len(parameters) == width else None

    def _write(self, parameters: bytes) -> int:
        """Takes a goal; returns the error byte."""
        address, goal = self._goal(parameters) or (None, 0)
        if address != self.model.address:
            return RANGE_ERROR[self.model.protocol]
        self._held = (goal - self.model.centre) * self.model.step
        return 0

    def _status(self, data: bytes, error: int = 0) -> Packet:
        error |= self.error
        if self.model.protocol == 1:
            return Packet(self.id, error, data)
        return Packet(self.id, STATUS, bytes((error,)) + data)


class ServoLine:
    """All servos on one line.  As on a real one, a broken or foreign packet gets no answer.

    Faults on request, each for all answers until it is taken back: ``corrupt`` (ids whose checksum is wrong),
    ``garbage`` (bytes sent before each answer), ``delay_s``; and ``silent``, ``error`` of a servo.
    """

    def __init__(self, servos: Iterable[VirtualServo]) -> None:
        self.servos = {servo.id: servo for servo in servos}
        self.corrupt: set[int] = set()
        self.garbage = b""
        self.delay_s = 0.0
        self._decoders = {protocol: decoder(protocol) for protocol in {s.model.protocol for s in self.servos.values()}}
        self._outbox: list[tuple[float, bytes]] = []

    @classmethod
    def of(cls, model: str, ids: Sequence[int], motion: Motion) -> Self:
        """A line of equal servos."""
        last = len(ids) - 1
        return cls(cls._servo(model, id, motion, SPREAD_S * (last - i)) for i, id in enumerate(ids))

    @staticmethod
    def _servo(model: str, id: int, motion: Motion, ahead: float) -> VirtualServo:
        return VirtualServo(MODELS[model], id, motion, ahead)

    def receive(self, data: bytes, now: float) -> None:
        """Takes bytes from the master; the answers are ready after the delay."""
        for protocol, stream in self._decoders.items():
            for packet in stream.feed(data):
                if packet is not None:
                    for servo, parameters in self._asked(packet, protocol):
                        status = servo.answer(Packet(packet.id, packet.code, parameters), now)
                        if status is not None:
                            self._send(status, protocol, now)

    def due(self) -> float:
        """When the next answer is ready [s]; inf when there is none."""
        return self._outbox[0][0] if self._outbox else math.inf

    def emit(self, now: float) -> bytes:
        """The answers that are ready."""
        ready = b"".join(frame for when, frame in self._outbox if when <= now)
        self._outbox = [(when, frame) for when, frame in self._outbox if when > now]
        return ready

    def _asked(self, packet: Packet, protocol: int) -> Iterable[tuple[VirtualServo, bytes]]:
        """The servos that an instruction is for, in the order of their answers, each with its parameters."""
        if packet.code == SYNC_READ:
            size = SYNC_HEADER[protocol]
            ids, parameters = packet.parameters[size:], packet.parameters[:size]
            asked = [self.servos[id] for id in ids if id in self.servos]
            for servo in asked:
                if servo.model.protocol != protocol or not servo.model.syncs:
                    continue
                if servo.silent:  # each waits for the one before it
                    return
                yield servo, parameters
            return
        for servo in self.servos.values():
            if servo.model.protocol == protocol and packet.id in (servo.id, BROADCAST):
                yield servo, packet.parameters

    def _send(self, status: Packet, protocol: int, now: float) -> None:
        frame = encode(status, protocol)
        if status.id in self.corrupt:
            frame = frame[:-1] + bytes((frame[-1] ^ 0x55,))
        self._outbox.append((now + self.delay_s, self.garbage + frame))
