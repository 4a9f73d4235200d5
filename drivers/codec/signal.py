"""A number within CAN frames, as a DBC file or a PDO mapping places it: many frames at once.  No I/O, no clock."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["Layout", "SignalError", "layout_of"]

FRAME = 8
"""bytes of a frame that are looked at"""


class SignalError(ValueError):
    """Bits that a frame has not."""


@dataclass(frozen=True, slots=True)
class Layout:
    """Bits of the frames ``id``, shifted up by ``shift`` in its first eight bytes, a number in the order "<" or ">".

    ends: the least length of the frame [byte]; value = scale x number + offset.
    """

    id: int
    shift: int
    bits: int
    signed: bool
    order: str
    ends: int
    scale: float = 1.0
    offset: float = 0.0

    def numbers(self, frames: Sequence[bytes]) -> NDArray[np.float64]:
        """The plain numbers, shape (N,), NaN where a frame is too short."""
        packed = b"".join([data[:FRAME].ljust(FRAME, b"\0") for data in frames])
        raw = np.frombuffer(packed, f"{self.order}u8").astype(np.uint64)
        top = np.uint64(64 - self.bits)
        raw = raw << np.uint64(64 - self.bits - self.shift)  # what lies above falls off
        plain = (raw.view(np.int64) >> np.int64(top) if self.signed else raw >> top).astype(float)
        short = [len(data) < self.ends for data in frames]
        if any(short):
            plain[short] = np.nan
        return plain

    def values(self, frames: Sequence[bytes]) -> NDArray[np.float64]:
        """The values in their unit, shape (N,), NaN where a frame is too short."""
        return self.numbers(frames) * self.scale + self.offset

    @property
    def largest(self) -> float:
        """The largest value on either side that the bits can show."""
        return abs(self.scale) * (2.0 ** (self.bits - 1) if self.signed else 2.0**self.bits) - abs(self.scale)


def layout_of(
    id: int, start: int, bits: int, big: bool, signed: bool, scale: float = 1.0, offset: float = 0.0
) -> Layout:
    """A layout from a DBC file's start bit, which is the lowest bit, or of a big-endian signal the highest.

    Raises SignalError for bits beyond the eighth byte.
    """
    first = start // 8 * 8 + 7 - start % 8 if big else start
    last = first + bits - 1
    if last >= 8 * FRAME:
        raise SignalError(f"found {bits} bits from bit {start} on, expected bits of the first {FRAME} bytes")
    return Layout(id, 63 - last if big else start, bits, signed, ">" if big else "<", last // 8 + 1, scale, offset)
