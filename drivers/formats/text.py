"""Tables as text of other programs: PlotJuggler's CSV, and what is separated by commas, semicolons, tabs or blanks.

text_layout.py finds the layout of a file; recording.py reads lostmotion's own CSV.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lostmotion.drivers.codec.recording_csv import ROWS_AT_ONCE
from lostmotion.drivers.errors import RecordingError
from lostmotion.drivers.formats.source import Series, check_count, shown
from lostmotion.drivers.formats.table import Table
from lostmotion.drivers.formats.text_layout import (
    Layout,
    called,
    cells_of,
    date,
    is_row,
    layout_of,
    lines_of,
    number,
)

__all__ = ["open_text"]

CELLS_AT_ONCE = 500_000
"""bounds the text held in memory: each cell takes some 60 bytes"""


def open_text(path: Path) -> Table:
    """Raises RecordingError."""
    layout, rows = layout_of(path)
    kind = "PlotJuggler CSV" if "__time" in layout.header else f"text separated by {called(layout.separator)}"
    units = [
        layout.metadata.get(f"{name}_unit") or below for name, below in zip(layout.header, layout.units, strict=True)
    ]
    numeric = [index for index in range(len(layout.header)) if _is_numeric(rows, index, layout)]
    series = [Series(layout.header[index], str(units[index])) for index in numeric]
    if not series:
        raise RecordingError(f"{path}: found text without a column of numbers, expected a table; is it a recording?")

    def load(names: Sequence[str]) -> Mapping[str, NDArray[Any]]:
        return _load(path, layout, [layout.header.index(name) for name in names])

    metadata = {key: value for key, value in layout.metadata.items() if not key.endswith("_unit")}
    return Table(str(path), kind, series, load, metadata=metadata)


def _load(path: Path, layout: Layout, indices: Sequence[int]) -> dict[str, NDArray[Any]]:
    """The columns of these numbers.  Raises RecordingError."""
    parts: dict[int, list[NDArray[Any]]] = {index: [] for index in indices}
    lines = islice(lines_of(path, layout.encoding), layout.skipped, None)
    line, count, most = layout.skipped + 1, 0, max(min(ROWS_AT_ONCE, CELLS_AT_ONCE // len(layout.header)), 1)
    while chunk := list(islice(lines, most)):
        numbered = [(line + i, text) for i, text in enumerate(chunk) if is_row(text)]
        rows = _rows(path, layout, numbered, indices)
        for index in indices:
            parts[index].append(_column([row[index] for row in rows], index, layout, path, [n for n, _ in numbered]))
        line += len(chunk)
        count += len(rows) * len(indices)
        check_count(str(path), count)
    return {layout.header[index]: np.concatenate(parts[index] or [np.empty(0)]) for index in indices}


def _rows(path: Path, layout: Layout, lines: list[tuple[int, str]], indices: Sequence[int]) -> list[list[str]]:
    """Cells, as many in each row as the header has; a last line that was cut off is left out."""
    width = len(layout.header)
    rows = [cells_of(text, layout.separator) for _, text in lines]
    if lines and not lines[-1][1].endswith("\n") and not _is_whole(rows[-1], layout, indices):
        rows.pop()
    for index, row in enumerate(rows):
        if len(row) == width or (len(row) > width and not any(cell.strip() for cell in row[width:])):
            continue
        raise RecordingError(
            f"{path}: line {lines[index][0]}: found {len(row)} cells separated by {called(layout.separator)}, "
            f"expected {width} as in the header"
        )
    return rows


def _is_whole(row: list[str], layout: Layout, indices: Sequence[int]) -> bool:
    """Whether a row without its newline may still be complete."""
    numbers = [index for index in indices if index not in layout.dates]
    return len(row) >= len(layout.header) and all(number(row[i], layout.decimal_comma) is not None for i in numbers)


def _column(cells: list[str], index: int, layout: Layout, path: Path, lines: Sequence[int]) -> NDArray[Any]:
    if index in layout.dates:
        return np.array([date(cell) for cell in cells], dtype="datetime64[ns]")
    try:
        if not layout.decimal_comma:
            return np.array([float(cell) if cell else math.nan for cell in cells])
    except ValueError:
        pass
    numbers = [number(cell, layout.decimal_comma) for cell in cells]
    if None in numbers:
        row = numbers.index(None)
        raise RecordingError(
            f"{path}: line {lines[row]}: found {cells[row][:40]!r} in {shown(layout.header[index])!r}, "
            "expected a number"
        )
    return np.array(numbers, dtype=float)


def _is_numeric(rows: list[list[str]], index: int, layout: Layout) -> bool:
    whole = [row for row in rows if len(row) >= len(layout.header)]
    return index in layout.dates or all(number(row[index], layout.decimal_comma) is not None for row in whole)
