"""Tables as text of other programs: PlotJuggler's CSV, and what is separated by commas, semicolons, tabs or blanks.

text_layout.py finds the layout of a file; recording.py reads lostmotion's own CSV.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lostmotion.drivers.codec.recording_csv import ROWS_AT_ONCE
from lostmotion.drivers.errors import RecordingError
from lostmotion.drivers.formats.cell_lists import unpacked
from lostmotion.drivers.formats.cells import date, number
from lostmotion.drivers.formats.guess import listed
from lostmotion.drivers.formats.labels import unlabelled
from lostmotion.drivers.formats.source import DATE, Series, check_count, shown
from lostmotion.drivers.formats.table import Table
from lostmotion.drivers.formats.text_layout import (
    LOOKED_AT,
    MOST_BROKEN,
    Layout,
    Lines,
    called,
    cells_of,
    is_row,
    layout_of,
    lines_of,
)
from lostmotion.drivers.formats.upright import upright
from lostmotion.drivers.formats.words import UNNAMED

__all__ = ["open_lines", "open_text"]

CELLS_AT_ONCE = 500_000
"""bounds the text held in memory: each cell takes some 60 bytes"""
MOST_EMPTY = 0.1
"""Share of the rows with a cell, below which a column without a name is none: the settings of an oscilloscope stand in
18 of 400 rows, beside the first of its samples.  Of 520 published files 0.02 keeps the settings of two, and 0.5 gives
the same columns."""
SHOWN = 40
"""characters of a cell in a message"""


def open_text(path: Path) -> Table:
    """Raises RecordingError."""
    return open_lines(str(path), "", lines_of(path))


def open_lines(name: str, kind: str, lines: Lines) -> Table:
    """A table of lines of text, whatever file they come from.  Raises RecordingError."""
    if any(_is_open(line) for line in islice(lines(), LOOKED_AT)):
        lines = partial(_whole, lines)
    lines, turned = upright(unpacked(unlabelled(lines)))
    layout, rows = layout_of(name, lines)
    plain = f"separated by {called(layout.separator)}" if len(layout.header) > 1 else "with one column"
    text = "text with a series in each row" if turned else f"text {plain}"
    text = "PlotJuggler CSV" if "__time" in layout.header else text
    units = [
        layout.metadata.get(f"{title}_unit") or below for title, below in zip(layout.header, layout.units, strict=True)
    ]
    numeric = [index for index in range(len(layout.header)) if _is_numeric(rows, index, layout)]
    series = [Series(layout.header[i], DATE if i in layout.dates else str(units[i])) for i in numeric]
    if not series:
        raise RecordingError(f"{name}: found text without a column of numbers, expected a table; is it a recording?")
    words = [layout.header[i] for i in range(len(layout.header)) if i not in numeric and _is_filled(rows, i)]
    left = [f"left out, as they hold words: {listed([Series(title) for title in words])}"] * bool(words)
    left += [turned] * bool(turned)
    notes = list(left)

    def load(names: Sequence[str]) -> Mapping[str, NDArray[Any]]:
        reading = _Reading(name, layout, [layout.header.index(title) for title in names])
        loaded = reading.load(lines)
        notes[:] = [*left, *reading.notes()]
        return loaded

    metadata = {key: value for key, value in layout.metadata.items() if not key.endswith("_unit")}
    return Table(name, kind or text, series, load, notes, metadata, rate=layout.rate)


def _whole(lines: Lines) -> Iterator[str]:
    """The rows, each in one line: a cell in quotes may hold the end of a line, as the answer of an instrument does.  A
    quote that is not closed in the next line is a sign, as of inches."""
    opened = ""
    for line in lines():
        is_odd = _is_open(line)
        if opened and is_odd:
            yield f"{opened.rstrip()} {line}"
            opened = ""
            continue
        if opened:
            yield opened
        opened = line if is_odd else ""
        if not is_odd:
            yield line
    if opened:
        yield opened


def _is_open(line: str) -> bool:
    """Whether a quote in a line is not closed."""
    return line.count('"') % 2 == 1


@dataclass(slots=True)
class _Reading:
    """Reads the columns of these indices.  broken: the number of a line that is no row, and why."""

    name: str
    layout: Layout
    indices: Sequence[int]
    broken: list[tuple[int, str]] = field(default_factory=list)

    def load(self, lines: Lines) -> dict[str, NDArray[Any]]:
        """Raises RecordingError."""
        layout = self.layout
        parts: dict[int, list[NDArray[Any]]] = {index: [] for index in self.indices}
        text = islice(lines(), layout.skipped, None)
        line, count, most = layout.skipped + 1, 0, max(min(ROWS_AT_ONCE, CELLS_AT_ONCE // len(layout.header)), 1)
        while chunk := list(islice(text, most)):
            rows = self._rows([(line + i, one) for i, one in enumerate(chunk) if is_row(one)])
            for index in self.indices:
                parts[index].append(_column([row[index] for row in rows], index, layout))
            line += len(chunk)
            count += len(rows) * len(self.indices)
            check_count(self.name, count)
        if len(self.broken) > MOST_BROKEN * (line - 1 - layout.skipped):
            number_of, why = self.broken[0]
            raise RecordingError(f"{self.name}: line {number_of}: {why}")
        return {layout.header[index]: np.concatenate(parts[index] or [np.empty(0)]) for index in self.indices}

    def _rows(self, lines: list[tuple[int, str]]) -> list[list[str]]:
        """Cells, as many in each row as the header has; a last line that was cut off is left out."""
        rows = []
        for place, text in lines:
            row = cells_of(text, self.layout.separator)
            if not (why := self._wrong(row)):
                rows.append(row)
            elif text.endswith("\n"):
                self.broken.append((place, why))
        return rows

    def _wrong(self, row: Sequence[str]) -> str:
        """What is wrong with a row, "" for nothing."""
        layout = self.layout
        width = len(layout.header)
        if len(row) < width or any(cell.strip() for cell in row[width:]):
            return f"found {len(row)} cells separated by {called(layout.separator)}, expected {width} as in the header"
        for index in self.indices:
            if index not in layout.dates and number(row[index], layout.decimal_comma) is None:
                return f"found {row[index][:SHOWN]!r} in {shown(layout.header[index])!r}, expected a number"
        return ""

    def notes(self) -> list[str]:
        """What a person should know of the lines that were left out."""
        if not self.broken:
            return []
        place, why = self.broken[0]
        return [f"{len(self.broken)} lines that are no rows were left out; line {place}: {why}"]


def _column(cells: list[str], index: int, layout: Layout) -> NDArray[Any]:
    if index in layout.dates:
        return np.array([date(cell) for cell in cells], dtype="datetime64[ns]")
    try:
        if not layout.decimal_comma:
            return np.array(cells, dtype=object).astype(float)
    except ValueError:
        pass
    return np.array([number(cell, layout.decimal_comma) for cell in cells], dtype=float)


def _is_filled(rows: list[list[str]], index: int) -> bool:
    """Whether a column holds more than a few cells."""
    return sum(bool(row[index].strip()) for row in rows) >= MOST_EMPTY * len(rows) > 0


def _is_numeric(rows: list[list[str]], index: int, layout: Layout) -> bool:
    """Whether a column holds numbers, but for a few rows that are none; without a name not mostly empty cells."""
    if index in layout.dates:
        return True
    found = sum(number(row[index], layout.decimal_comma) is not None for row in rows)
    filled = sum(bool(row[index].strip()) for row in rows)
    is_empty = UNNAMED.fullmatch(layout.header[index]) and filled < MOST_EMPTY * len(rows)
    return found >= (1 - MOST_BROKEN) * len(rows) and not is_empty
