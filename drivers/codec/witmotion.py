"""Frames of WitMotion's serial inertial sensors: 0x55, type, four int16 little-endian, sum of the first ten bytes.

Source: WitMotion, "WT901 serial protocol"; acceleration in g is raw / 32768 x 16.
"""

from __future__ import annotations

from dataclasses import dataclass
from struct import Struct
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from lostmotion.drivers.codec.stream import StreamDecoder
from lostmotion.drivers.units import STANDARD_GRAVITY

__all__ = ["ACCELERATION", "FRAME_SIZE", "FULL_SCALE_MS2", "WitDecoder", "WitFrame", "encode", "to_ms2"]

Raw = TypeVar("Raw", float, NDArray[np.float64])

HEADER = b"\x55"
FRAME_SIZE = 11
ACCELERATION = 0x51
TYPES = range(0x50, 0x5B)
"""time, acceleration, angular velocity, angle, magnetic field, ports, pressure, position, speed, …"""
FULL_SCALE_MS2 = 16 * STANDARD_GRAVITY
"""the range of ±16 g [m/s²]"""
VALUES = Struct("<4h")
ACCELERATES = HEADER + bytes((ACCELERATION,))


@dataclass(frozen=True, slots=True)
class WitFrame:
    """One frame: its type (0x51: acceleration) and four raw values (x, y, z, temperature in 0.01 °C)."""

    kind: int
    values: tuple[int, int, int, int]


def to_ms2(raw: Raw) -> Raw:
    """Acceleration [m/s²] of a raw value, or of many."""
    return raw / 32768 * FULL_SCALE_MS2


def encode(frame: WitFrame) -> bytes:
    """The 11 bytes of a frame."""
    body = HEADER + bytes((frame.kind,)) + VALUES.pack(*frame.values)
    return body + bytes((sum(body) & 0xFF,))


class WitDecoder(StreamDecoder[WitFrame]):
    """A stream decoder for all types of frames."""

    def __init__(self) -> None:
        super().__init__(HEADER, _length, _decode)

    def accelerations(self, data: bytes) -> list[tuple[int, ...]] | None:
        """The raw values of the frames that are complete now, in half the time of ``feed``; None, and nothing is taken
        in, where there is anything but accelerations, as there seldom is, or none of them: that is ``feed``'s."""
        stream = self._buffer + data
        end = len(stream) - len(stream) % FRAME_SIZE
        found = []
        for at in range(0, end, FRAME_SIZE):
            frame = stream[at : at + FRAME_SIZE]
            if not (frame.startswith(ACCELERATES) and _is_whole(frame)):
                return None
            found.append(VALUES.unpack_from(frame, 2))
        if found:
            self._buffer, self._in_garbage = stream[end:], False
        return found or None


def _length(buffer: bytearray, at: int) -> int | None:
    if len(buffer) - at < 2:
        return None
    return FRAME_SIZE if buffer[at + 1] in TYPES else 0


def _decode(frame: bytes) -> WitFrame | None:
    return WitFrame(frame[1], VALUES.unpack_from(frame, 2)) if _is_whole(frame) else None


def _is_whole(frame: bytes | bytearray) -> bool:
    """Whether its sum is right."""
    return sum(frame[:-1]) & 0xFF == frame[-1]
