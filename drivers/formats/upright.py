"""Tables that lie on their side: each row is a series, as a program saves a matrix of a few of them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from itertools import islice

from lostmotion.drivers.formats.cells import number
from lostmotion.drivers.formats.table import LEAST_ROWS
from lostmotion.drivers.formats.text_layout import SEPARATORS, Lines, cells_of, is_row

__all__ = ["upright"]


def upright(lines: Lines) -> tuple[Lines, str]:
    """The same lines; where they are fewer than a recording has rows, and each holds more numbers than that, perhaps
    behind its name, a table with a column for each line, and what a person should know of it ("" for nothing)."""
    rows = list(islice(filter(is_row, lines()), LEAST_ROWS + 1))
    if not rows or len(rows) > LEAST_ROWS:
        return lines, ""
    for separator in SEPARATORS:
        cells = [cells_of(line.strip(), separator) for line in rows]
        if len(cells[0]) > LEAST_ROWS and len({len(row) for row in cells}) == 1 and _are_series(cells):
            note = f"{len(cells)} rows of {len(cells[0])} numbers each: every row is read as a column"
            return partial(_turned, cells), note
    return lines, ""


def _are_series(rows: Sequence[Sequence[str]]) -> bool:
    """Whether rows hold numbers only, but for their first cells, which may be names in all of them."""
    are_named = all(row[0].strip() and number(row[0], decimal_comma=True) is None for row in rows)
    return all(number(cell, decimal_comma=True) is not None for row in rows for cell in row[are_named:])


def _turned(rows: Sequence[Sequence[str]]) -> Iterator[str]:
    for cells in zip(*rows, strict=True):
        yield ";".join(cells) + "\n"
