"""Which Feetech models there are, how they are asked, and what the bytes of their answers mean in SI units.

Their frames are those of Dynamixel's protocol 1.0 (``dynamixel.py``), with a sync read besides.  Numbers of two bytes
have the low byte first in servos with a magnetic encoder (STS, SMS), the high byte first in those with a potentiometer
(SCS, which obey no sync read).  Negative numbers are a magnitude and a sign bit.

Source: Feetech, "FT-SCS communication protocol" and the memory tables of the STS, SMS and SCS series; FTServo_Python.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from struct import Struct

from lostmotion.drivers.codec.dynamixel import BROADCAST, HEADER_1, SYNC_READ, Packet, Question, decoder, encode
from lostmotion.drivers.codec.servo_state import COMMAND, POSITION, ControlTable, Model, ServoState

__all__ = [
    "ADDRESS",
    "MODELS",
    "FeetechModel",
    "Listener",
    "SyncQuestion",
    "identity_question",
    "model_number",
    "number_bytes",
    "signed",
]

ADDRESS = 42
"""where the state block begins"""
BLOCK = {"<": Struct("<H12xHHxxBB5xH"), ">": Struct(">H12xHHxxBB")}
"""goal 42, position 56, speed 58, (load 60,) voltage 62, temperature 63, and of STS and SMS the current 69"""
SCS: ControlTable = {
    COMMAND: (42, 2), POSITION: (56, 2), "velocity": (58, 2), "voltage": (62, 1), "temperature": (63, 1),
}  # fmt: skip
CONTROL_TABLES: Mapping[str, ControlTable] = {"<": {**SCS, "current": (69, 2)}, ">": SCS}
IDENTITY, IDENTITY_SIZE, NUMBER = 0, 5, 3
"""what a servo is asked to know it by: both bytes of its firmware, the byte order, both of its model number at 3.  The
number alone would be as long as a READ's parameters, and a line that echoes would answer for a servo"""
SCS_SERIES = 5
"""the first byte of the model number of an SCS servo; 8 is SMS, 9 STS"""
SIGN = 0x8000
AMPERE = 6.5e-3


@dataclass(frozen=True, slots=True)
class FeetechModel(Model):
    """One kind of servo; order: "<" where numbers have the low byte first, else ">"."""

    order: str = "<"

    @property
    def block_size(self) -> int:
        """Bytes of the state block."""
        return BLOCK[self.order].size

    @property
    def address(self) -> int:
        """Where the state block begins."""
        return ADDRESS

    @property
    def syncs(self) -> bool:
        """Whether it obeys a sync read."""
        return self.order == "<"

    @property
    def control_table(self) -> ControlTable:
        """Where the servo keeps the values of its state."""
        return CONTROL_TABLES[self.order]

    def decode(self, block: bytes) -> ServoState:
        """The state block of ``block_size`` bytes in SI units.  Raises struct.error for another size.

        The load (address 60) is the drive's own effort, not measured, and no torque.
        """
        goal, position, speed, voltage, temperature, *rest = BLOCK[self.order].unpack(block)
        return ServoState(
            (signed(goal) - self.centre) * self.step,
            (signed(position) - self.centre) * self.step,
            signed(speed) * self.speed,
            voltage * 0.1,
            float(temperature),
            signed(rest[0]) * self.ampere if rest else math.nan,
        )

    def encode(self, state: ServoState) -> bytes:
        """The state block that a servo would show; the inverse of ``decode`` but for rounding."""
        angles = (_unsigned(round(angle / self.step) + self.centre) for angle in (state.command, state.position))
        speed = _unsigned(round(state.velocity / self.speed))
        numbers = [*angles, speed, round(state.voltage * 10), round(state.temperature)]
        if self.order == "<":
            numbers.append(0 if math.isnan(state.current) else _unsigned(round(state.current / self.ampere)))
        return BLOCK[self.order].pack(*numbers)


def _encoder(name: str, number: int) -> FeetechModel:
    step = math.tau / 4096
    return FeetechModel(name, number, 1, step, 2048, step, AMPERE, "<")


def _potentiometer(name: str, number: int) -> FeetechModel:
    step = math.radians(300 / 1024)
    return FeetechModel(name, number, 1, step, 512, step, order=">")


MODELS = {
    model.name: model
    for model in (
        _encoder("STS3215", 777),
        _encoder("STS3250", 2825),
        _encoder("SM8512BL", 11272),
        _potentiometer("SCS0009", 1284),
    )
}
"""The models by name; speeds are in counts a second."""


class SyncQuestion:
    """A sync read, made once and asked often: ``request`` is its frame.

    The servos answer in the order of ``ids``, each with ``size`` bytes from ``address`` on; all that is ``length``
    bytes and begins with ``start``.  Raises ValueError for too many ids.
    """

    def __init__(self, ids: Sequence[int], address: int, size: int) -> None:
        self.request = encode(Packet(BROADCAST, SYNC_READ, bytes((address, size, *ids))), 1)
        self.start = HEADER_1 + bytes((ids[0], size + 2))
        self.length = len(ids) * (size + 6)


class Listener:
    """Finds the answers of some servos in what comes in, whatever stands between them.

    ``found`` holds their bytes by id, ``broken`` counts what was thrown away; an answer of another size, or of a servo
    that was not asked, is neither.
    """

    def __init__(self, ids: Collection[int], size: int) -> None:
        self.found: dict[int, bytes] = {}
        self._ids = frozenset(ids)
        self._size = size
        self._decoder = decoder(1)

    @property
    def broken(self) -> int:
        """Frames and stretches of noise thrown away."""
        return self._decoder.broken

    def feed(self, chunks: Iterable[bytes]) -> None:
        """Listens until all have answered or there is no more."""
        for chunk in chunks:
            for packet in self._decoder.feed(chunk):
                if packet is not None and packet.id in self._ids and len(packet.parameters) == self._size:
                    self.found.setdefault(packet.id, packet.parameters)
            if len(self.found) == len(self._ids):
                return


def identity_question(id: int) -> Question:
    """What is asked to know which model a servo is; ``model_number`` reads the answer."""
    return Question(id, IDENTITY, IDENTITY_SIZE)


def model_number(identity: bytes) -> int:
    """The model number in the answer to ``identity_question``, in the byte order of its series."""
    number = identity[NUMBER : NUMBER + 2]
    return int.from_bytes(number, "big" if number[0] == SCS_SERIES else "little")


def number_bytes(model: FeetechModel) -> bytes:
    """The model number as the servo holds it at address 3."""
    return model.number.to_bytes(2, "little" if model.order == "<" else "big")


def signed(number: int) -> int:
    """A number of two bytes whose bit 15 is its sign."""
    return SIGN - number if number & SIGN else number


def _unsigned(number: int) -> int:
    return SIGN - number if number < 0 else number
