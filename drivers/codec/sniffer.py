"""Decodes the traffic between a master and its servos as a passive listener receives it, in both directions: which
registers were written, asked for and answered.

An answer does not contain its question, so the question before it is kept.  In protocol 1.0, Feetech's too, an answer
looks like an instruction whose code is its error byte: a frame of a servo that was asked, with as many bytes as it was
asked for, is its answer.  One with two bytes and the code of a READ is a READ: a master that asks a dead servo for one
value after the other is more usual than a servo beyond its angle limit (error 0x02).

Source: ROBOTIS e-Manual, "DYNAMIXEL Protocol 1.0" and "DYNAMIXEL Protocol 2.0"; Feetech, "FT-SCS communication
protocol".
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from enum import Enum

from lostmotion.drivers.codec.dynamixel import BROADCAST, READ, STATUS, SYNC_READ, WRITE, Packet, decoder

__all__ = ["AccessKind", "BusSniffer", "RegisterAccess"]

REG_WRITE, ACTION = 0x04, 0x05
SYNC_WRITE, FAST_SYNC_READ, BULK_READ, BULK_WRITE, FAST_BULK_READ = 0x83, 0x8A, 0x92, 0x93, 0x9A
FAST_EXTRA = 4
"""bytes of a servo's share of a fast answer beside what it was asked for: error, id, two of a checksum"""
Asked = tuple[int, int]
"""address and size of registers"""


class AccessKind(Enum):
    """What happened to registers."""

    ASKED = "asked"
    ANSWERED = "answered"
    WRITTEN = "written"


@dataclass(frozen=True, slots=True)
class RegisterAccess:
    """Registers of a servo from ``address`` on; data: as they were answered or written, b"" where they were asked
    for."""

    kind: AccessKind
    id: int
    address: int
    data: bytes = b""


class BusSniffer:
    """The traffic in one protocol, 1 or 2, taken in pieces as they come."""

    def __init__(self, protocol: int) -> None:
        self._packets = self._broken_before = 0
        self._protocol = protocol
        self._stream = decoder(protocol)
        self._width = protocol
        """bytes of an address, and of a size"""
        self._asked: dict[int, Asked] = {}
        """what servos were asked for, in the order in which they answer"""
        self._waiting: dict[int, RegisterAccess] = {}
        """writes that an ACTION carries out"""

    @property
    def broken(self) -> int:
        """Frames and pieces of noise that were thrown away."""
        return self._stream.broken

    @property
    def is_spoken(self) -> bool:
        """Whether more packets than pieces of noise came since ``reset``: in another protocol's frames, too, something
        looks like a packet now and then."""
        return self._packets > self.broken - self._broken_before

    def reset(self) -> None:
        """Forgets what has begun: the line is opened anew."""
        self._stream.reset()
        self._packets, self._broken_before = 0, self.broken
        self._asked, self._waiting = {}, {}

    def feed(self, data: bytes) -> Iterator[RegisterAccess]:
        """The register accesses in these bytes, in order."""
        for packet in self._stream.feed(data):
            if packet is not None:
                self._packets += 1
                yield from self._take(packet)

    def _take(self, packet: Packet) -> Iterator[RegisterAccess]:
        if self._protocol == 1:
            parameters = packet.parameters
            is_answer = packet.id in self._asked and len(parameters) in (0, self._asked[packet.id][1])
            if is_answer and not (packet.code == READ and len(parameters) == 2):
                yield from self._answered(packet.id, parameters)
            else:
                yield from self._instructed(packet)
        elif packet.code != STATUS:
            yield from self._instructed(packet)
        elif packet.id == BROADCAST:
            yield from self._fast(packet.parameters)
        else:
            yield from self._answered(packet.id, packet.parameters[1:])

    def _answered(self, id: int, data: bytes) -> Iterator[RegisterAccess]:
        address, size = self._asked.pop(id, (0, 0))
        if size and len(data) == size:
            yield RegisterAccess(AccessKind.ANSWERED, id, address, data)

    def _fast(self, parameters: bytes) -> Iterator[RegisterAccess]:
        """One answer for all: error, id, data and a checksum of each; the last checksum is the packet's."""
        at = 0
        for id, (_, size) in list(self._asked.items()):
            if len(parameters) < at + 2 + size or parameters[at + 1] != id:
                return
            yield from self._answered(id, parameters[at + 2 : at + 2 + size])
            at += size + FAST_EXTRA

    def _instructed(self, packet: Packet) -> Iterator[RegisterAccess]:
        self._asked = dict(self._wanted(packet.code, packet.id, packet.parameters))
        yield from (
            RegisterAccess(AccessKind.ASKED, id, address) for id, (address, size) in self._asked.items() if size
        )
        if packet.code == ACTION:
            yield from self._waiting.values()
            self._waiting = {}
        for access in self._written(packet.code, packet.id, packet.parameters):
            if packet.code == REG_WRITE:
                self._waiting[access.id] = access
            else:
                yield access

    def _wanted(self, code: int, id: int, parameters: bytes) -> Iterator[tuple[int, Asked]]:
        """Who answers an instruction, and what."""
        width = self._width
        if code == READ and len(parameters) == 2 * width:
            yield id, (_number(parameters[:width]), _number(parameters[width:]))
        elif code in (SYNC_READ, FAST_SYNC_READ) and len(parameters) > 2 * width:
            asked = _number(parameters[:width]), _number(parameters[width : 2 * width])
            yield from ((one, asked) for one in parameters[2 * width :])
        elif code in (BULK_READ, FAST_BULK_READ) and self._protocol == 2:
            for at in range(0, len(parameters) - 4, 5):
                yield parameters[at], (_number(parameters[at + 1 : at + 3]), _number(parameters[at + 3 : at + 5]))
        elif code == BULK_READ:
            for at in range(1, len(parameters) - 2, 3):
                yield parameters[at + 1], (parameters[at + 2], parameters[at])
        elif code in (WRITE, REG_WRITE) and id != BROADCAST:
            yield id, (0, 0)  # an empty answer, which is no instruction

    def _written(self, code: int, id: int, parameters: bytes) -> Iterator[RegisterAccess]:
        """The registers that an instruction writes."""
        width = self._width
        if code in (WRITE, REG_WRITE) and len(parameters) > width:
            yield RegisterAccess(AccessKind.WRITTEN, id, _number(parameters[:width]), parameters[width:])
        elif code == SYNC_WRITE and len(parameters) > 2 * width:
            address, size = _number(parameters[:width]), _number(parameters[width : 2 * width])
            shares = parameters[2 * width :]
            if len(shares) % (size + 1) == 0:
                for at in range(0, len(shares), size + 1):
                    yield RegisterAccess(AccessKind.WRITTEN, shares[at], address, shares[at + 1 : at + 1 + size])
        elif code == BULK_WRITE and self._protocol == 2:
            at = 0
            while at + 5 <= len(parameters):
                size = _number(parameters[at + 3 : at + 5])
                data = parameters[at + 5 : at + 5 + size]
                if len(data) == size:
                    yield RegisterAccess(AccessKind.WRITTEN, parameters[at], _number(parameters[at + 1 : at + 3]), data)
                at += 5 + size


def _number(data: bytes) -> int:
    return int.from_bytes(data, "little")
