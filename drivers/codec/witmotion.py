"""Frames of WitMotion's serial inertial sensors: 0x55, type, four int16 little-endian, sum of the first ten bytes.

Source: WitMotion, "WT901 serial protocol"; acceleration in g is raw / 32768 x 16.
"""

from __future__ import annotations

from dataclasses import dataclass
from struct import Struct

from lostmotion.drivers.codec.stream import StreamDecoder
from lostmotion.drivers.units import STANDARD_GRAVITY

__all__ = ["ACCELERATION", "FRAME_SIZE", "FULL_SCALE_MS2", "WitFrame", "decoder", "encode", "to_ms2"]

FRAME_SIZE = 11
ACCELERATION = 0x51
TYPES = range(0x50, 0x5B)
"""time, acceleration, angular velocity, angle, magnetic field, ports, pressure, position, speed, …"""
FULL_SCALE_MS2 = 16 * STANDARD_GRAVITY
"""the range of ±16 g [m/s²]"""
VALUES = Struct("<4h")


@dataclass(frozen=True, slots=True)
class WitFrame:
    """One frame: its type (0x51: acceleration) and four raw values (x, y, z, temperature in 0.01 °C)."""

    kind: int
    values: tuple[int, int, int, int]


def to_ms2(raw: float) -> float:
    """Acceleration [m/s²] of a raw value."""
    return raw / 32768 * FULL_SCALE_MS2


def encode(frame: WitFrame) -> bytes:
    """The 11 bytes of a frame."""
    body = bytes((0x55, frame.kind)) + VALUES.pack(*frame.values)
    return body + bytes((sum(body) & 0xFF,))


def decoder() -> StreamDecoder[WitFrame]:
    """A stream decoder for all types of frames."""
    return StreamDecoder(b"\x55", _length, _decode)


def _length(buffer: bytearray, at: int) -> int | None:
    if len(buffer) - at < 2:
        return None
    return FRAME_SIZE if buffer[at + 1] in TYPES else 0


def _decode(frame: bytes) -> WitFrame | None:
    if sum(frame[:-1]) & 0xFF != frame[-1]:
        return None
    return WitFrame(frame[1], VALUES.unpack_from(frame, 2))
