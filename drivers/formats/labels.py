"""Lines that name each of their numbers, as programs print them to a serial port: ``Time: 5001 Position: 596``, or
``t,5001,pos,596``."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator
from functools import partial
from itertools import islice

from lostmotion.drivers.formats.choice import NUMBER
from lostmotion.drivers.formats.text_layout import LOOKED_AT, Lines

__all__ = ["unlabelled"]

LABELLED = re.compile(
    rf"[,;|\s]*(?P<name>[^\W\d][\w .\[\]/-]*?(?:\([^)]*\))?)\s*[:=]\s*(?P<value>{NUMBER})"
    r"(?P<unit>\s*[A-Za-zµ°%]+[\w/^²]*(?![\w ]*[:=]))?"
)
"""a name, a number, and perhaps its unit"""
SIGNS, CELL = re.compile(r"[,;\t]"), re.compile(r"[^\W\d][\w .\[\]()/-]*")
"""between the cells of a line, and a name in one"""
LONGEST = 2000
"""Characters of a line; longer ones are of something else, and one of 80,000 would take more than 25 s."""
MOST = 0.5
"""Share of the lines that have the usual names; others are titles, or what a program says in between."""


def unlabelled(lines: Lines) -> Lines:
    """The same lines; where most of them name all of their numbers, a table with these names above it."""
    first = [line for line in islice(lines(), LOOKED_AT) if line.strip()]
    counted = Counter(names for line in first if (names := _names(line)))
    if not counted:
        return lines
    names, count = counted.most_common(1)[0]
    return partial(_each, lines, names) if len(names) > 1 and count > MOST * len(first) else lines


def _each(whole: Lines, names: tuple[str, ...]) -> Iterator[str]:
    yield ";".join(names) + "\n"
    for line in whole():
        found = _labelled(line)
        if tuple(name for name, _ in found) == names:
            yield ";".join(value for _, value in found) + ("\n" if line.endswith("\n") else "")


def _names(line: str) -> tuple[str, ...]:
    return tuple(name for name, _ in _labelled(line))


def _labelled(line: str) -> list[tuple[str, str]]:
    """The names of the numbers in a line, with their units in brackets, and the numbers; none where there is anything
    else."""
    if len(line) > LONGEST:
        return []
    found = list(LABELLED.finditer(line))
    ends = [0, *(one.end() for one in found)]
    is_whole = all(one.start() == end for one, end in zip(found, ends, strict=False)) and not line[ends[-1] :].strip(
        " ,;|\r\n\t"
    )
    if not found or not is_whole:
        return _paired(line)
    return [(one["name"].strip() + (f" [{one['unit'].strip()}]" if one["unit"] else ""), one["value"]) for one in found]


def _paired(line: str) -> list[tuple[str, str]]:
    """Names and numbers in turn, each in a cell: ``t,3406073,PWM,0``; none where there is anything else."""
    cells = [cell.strip() for cell in SIGNS.split(line.strip(" ,;\r\n\t"))]
    names, values = cells[::2], cells[1::2]
    is_whole = len(names) == len(values) == len({*names}) > 1
    if not (is_whole and all(map(CELL.fullmatch, names)) and all(re.fullmatch(NUMBER, value) for value in values)):
        return []
    return list(zip(names, values, strict=True))
