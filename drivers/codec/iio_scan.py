"""Scans of the Linux kernel's IIO buffers: the ``*_type`` files of sysfs, and the frame layout that they define.

Pure functions of texts and bytes.  Documentation/ABI/testing/sysfs-bus-iio describes the texts; the frame is laid out
as ``iio_compute_scan_bytes`` of drivers/iio/industrialio-buffer.c does it.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["ScanError", "ScanFormat", "ScanType"]

TYPE = re.compile(r"(be|le):([sSuU])(\d+)/(\d+)(?:X(\d+))?>>(\d+)")
STORAGE_BITS = (8, 16, 32, 64)


class ScanError(ValueError):
    """A type that is none, or that no kernel uses; the message has what was found and expected."""


@dataclass(frozen=True, slots=True)
class ScanType:
    """One element of a scan: ``le:s12/16>>4`` is a signed number of 12 bits, 4 bits up in 16, low byte first.

    repeat: how many of these follow each other (``le:s32/32X4>>0``, a quaternion).
    """

    is_big_endian: bool
    is_signed: bool
    bits: int
    storage_bits: int
    shift: int
    repeat: int = 1

    @classmethod
    def parse(cls, text: str) -> ScanType:
        """The type that a ``*_type`` file holds.  Raises ScanError."""
        found = TYPE.fullmatch(text.strip())
        if found is None:
            raise ScanError(f"found {text.strip()[:40]!r} as scan type, expected one such as le:s16/16>>0")
        order, sign, *numbers = found.groups(default="1")
        bits, storage, repeat, shift = map(int, numbers)
        if storage not in STORAGE_BITS or not 0 < bits <= storage - shift or repeat < 1:
            raise ScanError(f"found {found[0]!r} as scan type, expected bits that fit into 8, 16, 32 or 64")
        return cls(order == "be", sign in "sS", bits, storage, shift, repeat)

    @property
    def size(self) -> int:
        """Bytes in a scan, which also are the element's alignment."""
        return self.storage_bits // 8 * self.repeat

    @property
    def limits(self) -> tuple[int, int]:
        """The least and the greatest number that it can hold."""
        return (-(1 << self.bits - 1), (1 << self.bits - 1) - 1) if self.is_signed else (0, (1 << self.bits) - 1)


class ScanFormat:
    """The frame of the enabled elements.

    elements: by their names, in the order of their ``*_index``; the time stamp has the highest.  Each element begins at
    a multiple of its size, and a frame ends at a multiple of the largest (since Linux 5.5; before, a frame without time
    stamp might be shorter where its elements differ in size).
    """

    def __init__(self, elements: Mapping[str, ScanType]) -> None:
        self._elements = dict(elements)
        self._offsets: dict[str, int] = {}
        end = 0
        for name, element in self._elements.items():
            self._offsets[name] = _aligned(end, element.size)
            end = self._offsets[name] + element.size
        self.size = _aligned(end, max(element.size for element in self._elements.values()))
        self._dtype = np.dtype(
            {
                "names": list(self._elements),
                "formats": [(f"{'<>'[e.is_big_endian]}u{e.storage_bits // 8}", e.repeat) for e in elements.values()],
                "offsets": list(self._offsets.values()),
                "itemsize": self.size,
            }
        )

    def decode(self, data: bytes) -> dict[str, NDArray[np.int64] | NDArray[np.uint64]]:
        """The numbers of whole frames by the names of their elements, shape (frames,), or (frames, repeat) where an
        element repeats; 64 unsigned bits stay unsigned, all others are signed."""
        frames = np.frombuffer(data, self._dtype)
        return {name: _numbers(frames[name], element) for name, element in self._elements.items()}


def _numbers(raw: NDArray[np.unsignedinteger], element: ScanType) -> NDArray[np.int64] | NDArray[np.uint64]:
    """The valid bits are moved to the top, which drops what stands above them, and down again with their sign."""
    top = raw.astype(np.uint64) << np.uint64(64 - element.bits - element.shift)
    down = 64 - element.bits
    numbers = top.view(np.int64) >> np.int64(down) if element.is_signed else top >> np.uint64(down)
    if not element.is_signed and element.bits < 64:
        numbers = numbers.view(np.int64)
    return numbers[:, 0] if element.repeat == 1 else numbers


def _aligned(offset: int, size: int) -> int:
    return -(-offset // size) * size
