"""PDOs (CiA 301): which objects the bits of a frame are, by the mapping parameters, and their values.  No I/O, no
clock.  ``cia402.py`` has the meaning of a drive's objects.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

__all__ = ["DUMMIES", "Field", "Object", "PdoError", "fields_of", "value_of"]

MOST_BITS = 64
DUMMIES = range(0x0001, 0x0008)
"""indices of data types, which stand for a gap in a mapping"""
Object = tuple[int, int]
"""index and subindex"""


class PdoError(ValueError):
    """A mapping that no PDO can have."""


@dataclass(frozen=True, slots=True)
class Field:
    """The bits of one object in the frame taken as a little-endian number; ends: the least length of the frame that
    holds it [byte]."""

    shift: int
    bits: int
    signed: bool
    ends: int


def fields_of(entries: Sequence[int], signed: Iterable[Object]) -> Mapping[Object, Field]:
    """Where each object stands, by mapping parameters (index << 16 | subindex << 8 | length in bits), as in 0x1A00.

    signed: the objects that may be negative.  Raises PdoError.
    """
    fields: dict[Object, Field] = {}
    negative, shift = set(signed), 0
    for entry in entries:
        index, subindex, bits = entry >> 16, entry >> 8 & 0xFF, entry & 0xFF
        if not 0 <= entry <= 0xFFFFFFFF or not bits:
            raise PdoError(f"found {entry:#x}, expected index, subindex and bits as in 0x60640020")
        if shift + bits > MOST_BITS:
            raise PdoError(f"found {shift + bits} bits in one PDO, expected at most {MOST_BITS}")
        if index not in DUMMIES:
            known = (index, subindex)
            fields[known] = Field(shift, bits, known in negative, (shift + bits + 7) // 8)
        shift += bits
    return fields


def value_of(field: Field, number: int) -> int:
    """The value of a field in the frame's bytes as a little-endian number."""
    value = number >> field.shift & ((1 << field.bits) - 1)
    return value - (1 << field.bits) if field.signed and value >> (field.bits - 1) else value
