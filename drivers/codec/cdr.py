"""CDR, the bytes of ROS 2's messages: XCDR1 with its encapsulation header (OMG DDS-RTPS 2.5, 10), read and written.

Own code and not rosbags, which the service would have to carry for four messages; tests compare the two.
"""

from __future__ import annotations

import struct
from functools import lru_cache

__all__ = ["CdrError", "CdrReader", "CdrWriter"]

HEADER_BYTES = 4
ORDER = {b"\x00\x00": ">", b"\x00\x01": "<"}
"""by the first two bytes: plain CDR, big- or little-endian"""


class CdrError(ValueError):
    """The bytes are no message of the expected form."""


class CdrReader:
    """Takes one value after the other; every number begins at a multiple of its size.  All may raise CdrError."""

    def __init__(self, data: bytes) -> None:
        order = ORDER.get(data[:2]) if len(data) >= HEADER_BYTES else None
        if order is None:
            raise CdrError(
                f"found {data[:HEADER_BYTES].hex(' ') or 'no bytes'}, expected the header of CDR, 00 01 00 00"
            )
        self._data, self._order, self._at = data, order, HEADER_BYTES

    def numbers(self, letters: str) -> tuple[int | float, ...]:
        """Numbers of one size, as ``struct`` calls them: "iI", "9d"."""
        form, alignment = _form(self._order + letters)
        start = self._aligned(alignment)
        self._at = start + form.size
        if self._at > len(self._data):
            raise self._too_short()
        return form.unpack_from(self._data, start)

    def text(self) -> str:
        """A string, without its final NUL."""
        start, end = self._take(1)
        content = self._data[start:end]
        try:
            return content.removesuffix(b"\0").decode()
        except UnicodeDecodeError as error:
            raise CdrError(f"found bytes that are no UTF-8 at byte {start}, expected a text") from error

    def texts(self) -> tuple[str, ...]:
        """A sequence of strings."""
        count = self._count(HEADER_BYTES)
        return tuple(self.text() for _ in range(count))

    def doubles(self) -> tuple[float, ...]:
        """A sequence of float64."""
        count = self._count(8)
        return self.numbers(f"{count}d") if count else ()

    def skip_text(self) -> None:
        """Passes over a string."""
        self._take(1)

    def _count(self, size: int) -> int:
        """How many of a sequence follow; each takes at least ``size`` bytes."""
        count = int(self.numbers("I")[0])
        if count * size > len(self._data) - self._at:
            raise self._too_short()
        return count

    def _take(self, size: int) -> tuple[int, int]:
        count = self._count(size)
        start = self._at
        self._at += count * size
        return start, self._at

    def _aligned(self, size: int) -> int:
        return self._at + -(self._at - HEADER_BYTES) % size

    def _too_short(self) -> CdrError:
        return CdrError(f"the message ends at byte {len(self._data)} in the middle of a value")


class CdrWriter:
    """Little-endian bytes that grow."""

    def __init__(self) -> None:
        self._data = b""

    @property
    def data(self) -> bytes:
        """The message, with its encapsulation header."""
        return b"\x00\x01\x00\x00" + self._data

    def number(self, letter: str, value: int) -> None:
        """One number, as ``struct`` calls it: "i", "I", "B"."""
        form, size = _form("<" + letter)
        self._data += bytes(-len(self._data) % size) + form.pack(value)

    def text(self, value: str) -> None:
        """Length with the final NUL, then both."""
        content = value.encode() + b"\0"
        self.number("I", len(content))
        self._data += content


@lru_cache(maxsize=64)
def _form(letters: str) -> tuple[struct.Struct, int]:
    """The form of some numbers, and how the first is aligned."""
    return struct.Struct(letters), struct.calcsize("=" + letters[-1])
