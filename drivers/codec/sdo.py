"""SDO (CiA 301): reading one node's objects, as the client that asks and as the server that answers.  No I/O, no clock.

The client asks for objects of at most four bytes, which all are that it needs.  The server uploads of any length and
refuses block transfers, as the standard allows.
"""

from __future__ import annotations

import struct
from collections.abc import Callable

__all__ = [
    "NO_OBJECT",
    "NO_SUBINDEX",
    "READ_ONLY",
    "REQUEST",
    "RESPONSE",
    "WRONG_VALUE",
    "Abort",
    "SdoServer",
    "upload_request",
    "uploaded",
]

REQUEST, RESPONSE = 0x600, 0x580
"""COB-IDs before the node is added: from the client, from the server"""
HEAD, ABORT = struct.Struct("<BHB"), struct.Struct("<BHBL")
SIZE = 8
DOWNLOAD, UPLOAD, UPLOAD_SEGMENT, ABORTED = 0x20, 0x40, 0x60, 0x80
COMMAND, EXPEDITED, SIZED, TOGGLE, LAST = 0xE0, 0x02, 0x01, 0x10, 0x01
AT_ONCE, SEGMENT = 4, 7
"""bytes of an expedited answer, of a segment"""
TOGGLE_NOT_ALTERNATED, UNKNOWN_COMMAND = 0x05030000, 0x05040001
NO_OBJECT, NO_SUBINDEX, READ_ONLY, WRONG_VALUE = 0x06020000, 0x06090011, 0x06010002, 0x06090030


class Abort(Exception):  # noqa: N818 - the standard's name
    """An aborted transfer; code: as CiA 301 has it."""

    def __init__(self, code: int) -> None:
        super().__init__(f"abort 0x{code:08X}")
        self.code = code


def upload_request(index: int, subindex: int) -> bytes:
    """The question for an object."""
    return HEAD.pack(UPLOAD, index, subindex) + bytes(4)


def uploaded(index: int, subindex: int, data: bytes) -> int | None:
    """The unsigned value in a server's answer; None where it is no answer to this question, or longer than four bytes.

    Raises Abort.
    """
    if len(data) != SIZE:
        return None
    command, answered, sub = HEAD.unpack_from(data)
    if (answered, sub) != (index, subindex):
        return None
    if command == ABORTED:
        raise Abort(ABORT.unpack(data)[3])
    if command & COMMAND != UPLOAD or not command & EXPEDITED:
        return None
    size = AT_ONCE - (command >> 2 & 3) if command & SIZED else AT_ONCE
    return int.from_bytes(data[4 : 4 + size], "little")


class SdoServer:
    """Answers a client's requests.

    read: the bytes of an object by index and subindex; write: takes some; both may raise Abort.
    """

    def __init__(self, read: Callable[[int, int], bytes], write: Callable[[int, int, bytes], None]) -> None:
        self._read, self._write = read, write
        self._object = (0, 0)
        self._rest: bytes | None = None  # of an upload in segments
        self._toggle = 0

    def answer(self, request: bytes) -> bytes | None:
        """The answer to a frame; None to one that calls for none, such as a client's abort."""
        if len(request) != SIZE or request[0] & COMMAND == ABORTED:
            self._rest = None
            return None
        command = request[0] & COMMAND
        if command in (UPLOAD, DOWNLOAD):
            self._object = HEAD.unpack_from(request)[1:]
            self._rest = None
        try:
            if command == UPLOAD:
                return self._start()
            if command == UPLOAD_SEGMENT:
                return self._segment(request[0] & TOGGLE)
            if command == DOWNLOAD and request[0] & EXPEDITED:
                return self._take(request)
            raise Abort(UNKNOWN_COMMAND)
        except Abort as abort:
            self._rest = None
            return ABORT.pack(ABORTED, *self._object, abort.code)

    def _start(self) -> bytes:
        data = self._read(*self._object)
        if len(data) <= AT_ONCE:
            command = UPLOAD | EXPEDITED | SIZED | AT_ONCE - len(data) << 2
            return HEAD.pack(command, *self._object) + data.ljust(AT_ONCE, b"\0")
        self._rest, self._toggle = data, 0
        return HEAD.pack(UPLOAD | SIZED, *self._object) + len(data).to_bytes(4, "little")

    def _segment(self, toggle: int) -> bytes:
        if self._rest is None:
            raise Abort(UNKNOWN_COMMAND)
        if toggle != self._toggle:
            raise Abort(TOGGLE_NOT_ALTERNATED)
        piece, rest = self._rest[:SEGMENT], self._rest[SEGMENT:]
        self._toggle, self._rest = self._toggle ^ TOGGLE, rest or None
        command = toggle | SEGMENT - len(piece) << 1 | (0 if rest else LAST)
        return bytes((command,)) + piece.ljust(SEGMENT, b"\0")

    def _take(self, request: bytes) -> bytes:
        size = AT_ONCE - (request[0] >> 2 & 3) if request[0] & SIZED else AT_ONCE
        self._write(*self._object, request[4 : 4 + size])
        return HEAD.pack(UPLOAD_SEGMENT, *self._object) + bytes(4)
