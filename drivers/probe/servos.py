"""Which servos answer on a port, at one baud rate: pings, and a read of model number and id.  Nothing is ever written.

Frames and models are in ``codec``.  Dynamixel's protocol 1.0 and Feetech's servos share their frames; the first
bytes of the control table determine which of them it is.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass

from lostmotion.drivers.codec import feetech
from lostmotion.drivers.codec.dynamixel import BROADCAST, PING, STATUS, Packet, Question, decoder, encode
from lostmotion.drivers.codec.servo_state import MODELS, Model
from lostmotion.drivers.serial_port import SerialPort

__all__ = ["RATES", "FoundServo", "servos_at"]

RATES = (
    1_000_000, 57_600, 115_200, 500_000, 2_000_000, 250_000, 9_600, 19_200,
    38_400, 76_800, 128_000, 200_000, 400_000, 3_000_000, 4_000_000, 4_500_000,
)  # fmt: skip
"""[bit/s] of Dynamixel's and Feetech's tables, those as shipped first"""
BROADCAST_S = 0.8
"""how long all may take to answer a ping for all: 3 ms an id, one after the other"""
ALONE_S = 0.022
"""how long one may take, with an FTDI adapter's latency of 16 ms as shipped; a later answer still counts"""
LAST_ID = 252
SHY_RATES, SHY_IDS = (1_000_000, 57_600, 115_200, 500_000), range(21)
"""where servos are also looked for that answer no ping for all, as Feetech's SCS: usual baud rates and ids"""
TRIES = 3
TABLE = 6
"""bytes from address 0 on, with model and id"""
DYNAMIXEL_ID, FEETECH_ID = 3, 5
"""place of the id in them"""

Step = Callable[[float], None]
"""gets the share of the work at this rate that is done; may raise to end it"""


@dataclass(frozen=True, slots=True)
class FoundServo:
    """A servo that answered; driver: the one that reads it; model: its name, "" where it is unknown."""

    driver: str
    id: int
    model: str
    number: int
    protocol: int
    baudrate: int


def servos_at(port: SerialPort, step: Step) -> list[FoundServo]:
    """All servos on an open port that answer at its baud rate, by their ids.  Raises PortError."""
    found = _modern(port)
    step(0.3)
    found += _classic(port, step)
    return sorted(found, key=lambda servo: servo.id)


def _modern(port: SerialPort) -> list[FoundServo]:
    """Those of protocol 2.0, which send their model number in the answer to a ping."""
    found = {}
    for packet in _answers(port, Packet(BROADCAST, PING), 2, BROADCAST_S):
        if packet.code == STATUS and len(packet.parameters) == 4 and packet.id <= LAST_ID:
            number = int.from_bytes(packet.parameters[1:3], "little")
            found[packet.id] = FoundServo("dynamixel", packet.id, _name(number, 2), number, 2, port.baudrate)
    return list(found.values())


def _classic(port: SerialPort, step: Step) -> list[FoundServo]:
    """Those with the frames of protocol 1.0: all together, whose answers may collide, and if there are any one by one;
    where nothing answers, the usual ids are tried.

    An adapter that echoes repeats the question; no servo is accepted before it has sent its table.
    """
    ping = encode(Packet(BROADCAST, PING), 1)
    received = _ask(port, ping, BROADCAST_S, lambda data: len(data) > len(ping))
    ids = {packet.id for packet in decoder(1).feed(received) if packet is not None}
    if not received.replace(ping, b""):
        if port.baudrate in SHY_RATES:
            ids = _alone(port, SHY_IDS, step)
        if not ids:
            return []
    ids |= _alone(port, range(LAST_ID + 1), step)
    servos = (_asked(port, id) for id in sorted(ids) if id <= LAST_ID)
    return [servo for servo in servos if servo is not None]


def _alone(port: SerialPort, ids: range, step: Step) -> set[int]:
    """Those of some ids that answer a ping of their own; a late answer counts for whom it is from."""
    found = set[int]()
    for id in ids:
        step(0.3 + 0.7 * id / LAST_ID)
        found |= {packet.id for packet in _answers(port, Packet(id, PING), 1, ALONE_S)}
    return found


def _asked(port: SerialPort, id: int) -> FoundServo | None:
    question = Question(id, 0, TABLE)
    for _ in range(TRIES):
        stream = decoder(1)
        received = _ask(port, question.request, 2 * ALONE_S, lambda data: len(data) >= question.length)
        for packet in stream.feed(received):
            if packet is not None and packet.id == id and len(packet.parameters) == TABLE:
                return _recognised(id, packet.parameters, port.baudrate)
    return None


def _recognised(id: int, table: bytes, baudrate: int) -> FoundServo:
    """Dynamixel, when number and id stand where it has them; else Feetech."""
    number = int.from_bytes(table[:2], "little")
    other = feetech.model_number(table[: feetech.IDENTITY_SIZE])
    dynamixel = _name(number, 1) and table[DYNAMIXEL_ID] == id
    if dynamixel or (table[FEETECH_ID] != id and table[DYNAMIXEL_ID] == id):
        return FoundServo("dynamixel", id, _name(number, 1), number, 1, baudrate)
    return FoundServo("feetech", id, _named(feetech.MODELS.values(), other, 1), other, 1, baudrate)


def _name(number: int, protocol: int) -> str:
    return _named(MODELS.values(), number, protocol)


def _named(models: Iterable[Model], number: int, protocol: int) -> str:
    return next((model.name for model in models if (model.number, model.protocol) == (number, protocol)), "")


def _answers(port: SerialPort, question: Packet, protocol: int, seconds: float) -> list[Packet]:
    """What answered a question; as soon as the one it was for has, unless it was for all."""
    stream, found, request = decoder(protocol), list[Packet](), encode(question, protocol)

    def is_enough(data: bytes) -> bool:
        return question.id != BROADCAST and len(data) >= len(request) and data != request

    received = _ask(port, request, seconds, is_enough).replace(request, b"", 1)
    found += [packet for packet in stream.feed(received) if packet is not None]
    return found


def _ask(port: SerialPort, request: bytes, seconds: float, is_enough: Callable[[bytes], bool]) -> bytes:
    """What comes in after a request until it is enough, or the time is over."""
    port.write(request)
    received, end = b"", time.monotonic() + seconds
    while not is_enough(received) and (left := end - time.monotonic()) > 0:
        received += port.read(left)
    return received
