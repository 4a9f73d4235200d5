"""What stands above a table of the rate of its rows: ``Sample rate: 1000 Hz``, ``Delta_X 0.001``, or a line of names
above one of numbers."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from itertools import pairwise

from lostmotion.drivers.formats.cells import number
from lostmotion.drivers.formats.rates import ROWS
from lostmotion.drivers.units import to_si

__all__ = ["LONGEST_NAME", "are_settings", "rate_above"]

SIGNS = re.compile(r"[,;\t|]")
"""between the cells of such lines"""
RATE = re.compile(r"(sampl\w*|actual|scan|frame|data|acquisition)[ _-]*(rate|freq(uency)?)|fs|fps", re.I)
INTERVAL = re.compile(
    r"(sampl\w*|scan|frame|data)[ _-]*(interval|period|time)|delta[ _]?[xt]|time[ _-]*(step|interval)|dt|ts", re.I
)
QUANTITY = re.compile(
    r"""[\s:="']*(?P<number>\d+(?:\.\d*)?(?:[eE][+-]?\d+)?)\s*[(\[]?(?P<unit>[a-zA-Zµμ]*)(?=[\s,;|)\]"']|$)"""
)
"""what stands behind a name"""
UNIT = re.compile(r"[\s_]*[(\[]?(?<![a-z])(?P<unit>[kM]?hz|[mµμun]?s|sec)[)\]]?$", re.I)
"""at the end of a name"""
LONGEST_NAME = 60
"""characters of a name in a comment, which may also be a sentence with commas"""
HERTZ = {"": 1.0, "hz": 1.0, "khz": 1e3, "mhz": 1e6, "fps": 1.0, "sps": 1.0}


def are_settings(names: str, numbers: str) -> bool:
    """Whether a line of names stands above one of as many numbers, two or more."""
    above, below = (SIGNS.split(line.strip()) for line in (names, numbers))
    return (
        len(above) == len(below) > 1
        and all(_is_number(cell) for cell in below)
        and all(cell.strip() and not _is_number(cell) for cell in above)
    )


def rate_above(lines: Sequence[str]) -> tuple[str, float]:
    """The name of the rate in the lines above a table, and its rows a second; "" and 0.0 for none."""
    for name, value in _named(lines):
        plain = name.strip().strip("#%/\"' :=")
        if len(plain) > LONGEST_NAME or not (found := QUANTITY.match(value)):
            continue
        plain, own = _parted(plain)
        size, unit = float(found["number"]), found["unit"] or own
        rate = size * HERTZ.get(unit.lower(), 0.0) if RATE.fullmatch(plain) else 0.0
        if INTERVAL.fullmatch(plain) and size > 0 and (known := to_si(unit or "s")) and known[0] == "s":
            rate = 1 / (size * known[1])
        if ROWS[0] <= rate <= ROWS[1]:
            return plain, rate
    return "", 0.0


def _named(lines: Sequence[str]) -> Iterator[tuple[str, str]]:
    """Names and what stands behind them, or below them."""
    for above, below in pairwise(lines):
        if are_settings(above, below):
            yield from zip(SIGNS.split(above.strip()), SIGNS.split(below.strip()), strict=True)
    for line in lines:
        for sign in (":", "=", ",", ";", "\t"):
            name, is_parted, value = line.partition(sign)
            if is_parted:
                yield name, value


def _parted(name: str) -> tuple[str, str]:
    """A name and the unit at its end."""
    found = UNIT.search(name)
    return (name[: found.start()], found["unit"]) if found and found.start() else (name, "")


def _is_number(cell: str) -> bool:
    return number(cell, decimal_comma=False) is not None and bool(cell.strip())
