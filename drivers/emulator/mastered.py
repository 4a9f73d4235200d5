"""A line of servos with a master of its own, and what a second adapter receives on it.  No I/O of its own."""

from __future__ import annotations

import math
from collections.abc import Iterator

from lostmotion.drivers.codec.dynamixel import BROADCAST, READ, SYNC_READ, Packet, encode
from lostmotion.drivers.codec.sniffer import SYNC_WRITE
from lostmotion.drivers.emulator.server import Device
from lostmotion.drivers.emulator.servos import ServoLine

__all__ = ["MasteredLine", "Tap", "TappedLine"]

PERIOD_S = 0.01


class Tap:
    """The second adapter: emits what it is fed, and keeps in ``received`` what a host sends into it."""

    def __init__(self) -> None:
        self.received = b""
        self._buffer = b""

    def feed(self, data: bytes) -> None:
        """Takes bytes from the line."""
        self._buffer += data

    def receive(self, data: bytes, now: float) -> None:
        """Takes bytes from the host, which ought to send none."""
        self.received += data

    def due(self) -> float:
        """At once, when the buffer holds bytes."""
        return 0.0 if self._buffer else math.inf

    def emit(self, now: float) -> bytes:
        """The bytes of the buffer."""
        data, self._buffer = self._buffer, b""
        return data


class TappedLine:
    """A device on a line at which a ``tap`` listens in both directions."""

    def __init__(self, device: Device, tap: Tap) -> None:
        self._device, self._tap = device, tap

    def receive(self, data: bytes, now: float) -> None:
        """Takes bytes from the master."""
        self._tap.feed(data)
        self._device.receive(data, now)

    def due(self) -> float:
        """When the device wants to send next [s]."""
        return self._device.due()

    def emit(self, now: float) -> bytes:
        """What the device sends now."""
        data = self._device.emit(now)
        self._tap.feed(data)
        return data


class MasteredLine(Tap):
    """Servos whose master writes goals and reads positions, as an arm's controller does, every 10 ms, for a tap.

    The goals are those of the servos' own motion, so they are not delivered to them.
    """

    def __init__(self, line: ServoLine) -> None:
        super().__init__()
        self.line = line
        self._next = 0.0

    def due(self) -> float:
        """When the master begins the next round [s]."""
        return self._next

    def emit(self, now: float) -> bytes:
        """All bytes of a round."""
        self._next = now + PERIOD_S if now > self._next + 10 * PERIOD_S else self._next + PERIOD_S
        sent = b""
        for protocol, packet in self._round(now):
            request = encode(packet, protocol)
            self.line.receive(request, now)
            sent += request + self.line.emit(now)
        return sent

    def _round(self, now: float) -> Iterator[tuple[int, Packet]]:
        kinds: dict[tuple[int, int, bool], list[int]] = {}
        for id, servo in self.line.servos.items():
            kinds.setdefault((servo.model.protocol, servo.model.address, servo.model.syncs), []).append(id)
        for (protocol, address, _), ids in kinds.items():
            yield protocol, self._goals(protocol, address, ids, now)
            yield from ((protocol, packet) for packet in self._questions(protocol, ids))

    def _goals(self, protocol: int, address: int, ids: list[int], now: float) -> Packet:
        size = 2 * protocol
        shares = b"".join(bytes((id,)) + self.line.servos[id].block(now)[:size] for id in ids)
        return Packet(BROADCAST, SYNC_WRITE, _numbers(protocol, address, size) + shares)

    def _questions(self, protocol: int, ids: list[int]) -> Iterator[Packet]:
        model = self.line.servos[ids[0]].model
        asked = _numbers(protocol, model.address, model.block_size)
        if model.syncs:
            yield Packet(BROADCAST, SYNC_READ, asked + bytes(ids))
        else:
            yield from (Packet(id, READ, asked) for id in ids)


def _numbers(protocol: int, *numbers: int) -> bytes:
    return b"".join(number.to_bytes(protocol, "little") for number in numbers)
