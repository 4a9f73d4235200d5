"""CAN frames as the text of a serial adapter (slcan, Lawicel): ``t1234…\\r``.  No I/O.

python-can has an interface of that name, too; it reads a byte at a time, takes any bytes for silence, and shares its
port with any other program.
"""

from __future__ import annotations

import re

__all__ = ["CLOSE", "OPEN", "SPEEDS", "SlcanDecoder", "encode"]

SPEEDS = {10_000: 0, 20_000: 1, 50_000: 2, 100_000: 3, 125_000: 4, 250_000: 5, 500_000: 6, 750_000: 7, 1_000_000: 8,
          83_300: 9}  # fmt: skip
"""the digit after S that sets a bit rate"""
OPEN, CLOSE = b"O\r", b"C\r"
FRAME = re.compile(rb"(?:t([0-9A-Fa-f]{3})|T([0-9A-Fa-f]{8}))([0-8])((?:[0-9A-Fa-f]{2})*)")
MOST = 64
"""bytes of a line; more without an end are none of an adapter's"""
STAMP = 4
"""hex digits of an adapter's own time, which may follow a frame"""
OWN = b"zZFVN\a"
"""how an adapter's answers to commands begin"""


def encode(id: int, data: bytes) -> bytes:
    """A data frame with an 11-bit identifier, or one of 29 bits where it is larger."""
    head = b"t%03X" % id if id < 0x800 else b"T%08X" % id
    return head + b"%d" % len(data) + data.hex().upper().encode() + b"\r"


class SlcanDecoder:
    """Bytes → frames; foreign: the first bytes that are none of an adapter's; broken: how many such lines came."""

    def __init__(self) -> None:
        self._rest = b""
        self._synchronised = False
        self.foreign = b""
        self.broken = 0

    def feed(self, data: bytes) -> list[tuple[int, bytes]]:
        """The identifiers and data of the frames that are complete now; remote frames are left out."""
        *lines, self._rest = (self._rest + data).split(b"\r")
        frames = [frame for line in lines if (frame := self._frame(line)) is not None]
        if len(self._rest) > MOST:
            self._refuse(self._rest)
            self._rest = b""
        return frames

    def _frame(self, line: bytes) -> tuple[int, bytes] | None:
        line = line.lstrip(b"\a")
        found = FRAME.fullmatch(line)
        if found:
            size, digits = int(found[3]), found[4]
            if len(digits) in (2 * size, 2 * size + STAMP):
                self._synchronised = True
                return int(found[1] or found[2], 16), bytes.fromhex(digits[: 2 * size].decode())
        elif not line or line[:1] in OWN or line[:1] in b"rR":
            return None
        self._refuse(line)
        return None

    def _refuse(self, line: bytes) -> None:
        """The first line may be the rest of one that began before the port was opened."""
        if self._synchronised or self.broken or not _is_hex(line):
            self.broken += 1
            self.foreign = self.foreign or line[:MOST]


def _is_hex(line: bytes) -> bool:
    return re.fullmatch(rb"[0-9A-Fa-f]*", line) is not None
