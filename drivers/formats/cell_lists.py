"""Text tables with lists in their cells, as "[0.1, 0.2]" of all joints of a robot, or "(120, 85)" of a point in a film:
each number gets its own cell."""

from __future__ import annotations

import re
from collections.abc import Iterator
from functools import partial
from itertools import islice

from lostmotion.drivers.formats.text_layout import SEPARATORS, Lines, cells_of

__all__ = ["unpacked"]

LIST = re.compile(r"\s*(?:\[(\s*(?:[-+.\d]|nan)[^\[\]]*|\s*)\]|\((\s*[-+.\d][^()]*,[^()]*)\))\s*")
"""of numbers: ``[m/s]`` is a unit, and ``(3.5)`` no list"""
LOOKED_AT = 2
"""lines: the titles and the first row"""


def unpacked(lines: Lines) -> Lines:
    """The same lines; where the first row below the titles has lists, without blank ones, and with the numbers of each
    in cells of their own, titled ``positions[0]``, ``positions[1]`` and so on; those of the only point x and y."""
    first = list(islice(_written(lines), LOOKED_AT))
    if len(first) < LOOKED_AT or not LIST.search(first[1]):
        return lines
    for separator in SEPARATORS:
        titles, row = (cells_of(line, separator) for line in first)
        counts = [_count(cell) for cell in row]
        if len(titles) == len(row) and any(counts):
            return partial(_each, lines, separator, counts)
    return lines


def _each(whole: Lines, separator: str, counts: list[int]) -> Iterator[str]:
    """counts: of the numbers in the lists of a row, 0 for other cells."""
    lines = _written(whole)
    titles = cells_of(next(lines), separator)
    is_point = [count for count in counts if count] == [2] and "x" not in titles
    names = [
        ("xy"[place] if is_point else f"{title.strip()}[{place}]") if count else title
        for title, count in zip(titles, counts, strict=True)
        for place in range(count or 1)
    ]
    yield separator.join(names) + "\n"
    for line in lines:
        cells = [part for cell in cells_of(line, separator) for part in (_parts(cell) if _count(cell) else [cell])]
        yield separator.join(cells) + ("\n" if line.endswith("\n") else "")


def _written(lines: Lines) -> Iterator[str]:
    """Those that are not blank."""
    return (line for line in lines() if line.strip())


def _count(cell: str) -> int:
    """The length of the list in a cell, 0 for none."""
    return len(_parts(cell)) if LIST.fullmatch(cell) else 0


def _parts(cell: str) -> list[str]:
    """Separated by commas or, as numpy prints them, by blanks."""
    return [part for part in re.split(r"[,\s]+", cell.strip().strip("[]()")) if part]
