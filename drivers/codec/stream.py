"""Framing: finds packets in a stream of bytes, for all framed protocols.

No particular protocol, no I/O.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Generic, TypeVar

__all__ = ["StreamDecoder"]

T = TypeVar("T")


class StreamDecoder(Generic[T]):
    """Cuts a stream into packets and resynchronises after garbage.

    ``header`` opens every frame.  ``length(buffer, at)`` is the length of the frame that begins at ``at``: 0 when no
    frame can begin so, None when that needs more bytes.  ``decode(frame)`` gives the packet, None for a wrong checksum.

    After a bad frame the search goes on one byte further, so that a truncated or corrupted frame loses only itself.
    ``broken`` counts what was thrown away: each stretch of bytes between packets once, and each header in it that led
    to no packet.  The result does not depend on how the stream was cut into chunks.
    """

    def __init__(
        self,
        header: bytes,
        length: Callable[[bytearray, int], int | None],
        decode: Callable[[bytes], T | None],
    ) -> None:
        self.broken = 0
        self._header = header
        self._length = length
        self._decode = decode
        self._buffer = bytearray()
        self._in_garbage = False

    def feed(self, data: bytes) -> list[T | None]:
        """The packets that are complete now, in order; None stands where something was thrown away and counted."""
        buffer, found, start = self._buffer, list[T | None](), 0
        buffer += data
        end = len(buffer)
        while start < end:
            at = buffer.find(self._header, start)
            if at < 0:
                at = max(start, end - self._begun_header())
            if at > start:
                self._discard(found, is_header=False)
                start = at
                continue
            length = self._length(buffer, at)
            if length is None or end - at < length:
                break
            packet = self._decode(bytes(buffer[at : at + length])) if length else None
            if packet is None:
                self._discard(found, is_header=True)
                start = at + 1
            else:
                found.append(packet)
                self._in_garbage = False
                start = at + length
        del buffer[:start]
        return found

    def reset(self) -> None:
        """Forgets a frame that has begun: the line was quiet, or was opened anew."""
        self._buffer.clear()
        self._in_garbage = False

    def _discard(self, found: list[T | None], is_header: bool) -> None:
        if is_header or not self._in_garbage:
            self.broken += 1
            found.append(None)
        self._in_garbage = True

    def _begun_header(self) -> int:
        """How many bytes at the end of the buffer may be the beginning of a header."""
        for size in range(len(self._header) - 1, 0, -1):
            if self._buffer.endswith(self._header[:size]):
                return size
        return 0
