"""Tables as text of other programs: PlotJuggler's CSV, and what is separated by commas, semicolons, tabs or blanks.

The separator, a decimal comma, a header behind ``#`` and a line of units below the header are found out; lostmotion's
own CSV is recording.py's.
"""

from __future__ import annotations

import csv
import math
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lostmotion.drivers.codec.recording_csv import LONGEST_LINE, ROWS_AT_ONCE
from lostmotion.drivers.errors import RecordingError
from lostmotion.drivers.formats.source import MOST_SERIES, Series, check_count, shown, too_many
from lostmotion.drivers.formats.table import Table
from lostmotion.drivers.formats.words import SPELT, is_time
from lostmotion.drivers.toml_text import TomlError, loads
from lostmotion.drivers.units import to_si

__all__ = ["open_text"]

SEPARATORS = ",;\t|"
COMMENT = ("#", "%", "//")
CELLS_AT_ONCE = 500_000
"""bounds the text held in memory: each cell takes some 60 bytes"""
LOOKED_AT = 200
"""rows, to tell numbers from words"""
LONGEST = 100 * LONGEST_LINE
"""of a line; MOST_SERIES names of 100 characters are a tenth of it"""
NOTHING = {"", "nan", "null", "none", "na", "n/a", "-", "--", "?"}
"""cells that stand for no number, in lower case"""
DECIMAL_COMMA = re.compile(r"\s*[+-]?\d+,\d+(?:[eE][+-]?\d+)?\s*")


@dataclass(frozen=True, slots=True)
class Layout:
    """separator: " " for any blanks; header: the names; units: of a line below it, "" for none; skipped: lines before
    the rows; metadata: of ``# key = value`` lines, as in lostmotion's own files."""

    encoding: str
    separator: str
    header: Sequence[str]
    units: Sequence[str]
    skipped: int
    decimal_comma: bool
    dates: frozenset[int]
    metadata: Mapping[str, Any]


def open_text(path: Path) -> Table:
    """Raises RecordingError."""
    layout, rows = _layout(path)
    kind = "PlotJuggler CSV" if "__time" in layout.header else f"text separated by {_called(layout.separator)}"
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


def _layout(path: Path) -> tuple[Layout, list[list[str]]]:
    """How the text is laid out, and its first rows.  Raises RecordingError."""
    encoding = _encoding(path)
    comments: list[str] = []
    lines: list[str] = []
    places: list[int] = []
    for number, line in enumerate(islice(_lines(path, encoding), 4 * LOOKED_AT), start=1):
        if not lines and line.startswith(COMMENT):
            comments.append(line)
        elif line.strip() and len(lines) < LOOKED_AT:
            lines.append(line)
            places.append(number)
    if not lines:
        raise RecordingError(f"{path}: found no rows, expected a table of numbers with a header; the file is empty")
    separator = _separator(lines[0])
    comma = separator != "," and any(DECIMAL_COMMA.fullmatch(cell) for cell in _cells(lines[-1], separator))
    rows = [_cells(line, separator) for line in lines]
    header, rows = _header(comments, rows, separator, comma)
    if len(header) > MOST_SERIES:
        raise too_many(str(path), len(header), "columns")
    units = _units(rows[0], comma) if rows else []
    dates = frozenset(index for index, name in enumerate(header) if is_time(name) and _is_date(rows, index))
    before = len(lines) - len(rows) + bool(units)
    skipped = places[before - 1] if before else 0
    below = units or [""] * len(header)
    layout = Layout(encoding, separator, header, below, skipped, comma, dates, _metadata(comments))
    whole = rows if lines[-1].endswith("\n") else rows[:-1]
    return layout, whole[1:] if units else whole


def _metadata(comments: list[str]) -> dict[str, Any]:
    """What the comments say as ``key = value``; others are for people."""
    metadata: dict[str, Any] = {}
    for line in comments:
        with suppress(TomlError):
            metadata.update(loads(line.lstrip("#").strip()))
    return metadata


def _header(
    comments: list[str], rows: list[list[str]], separator: str, comma: bool
) -> tuple[list[str], list[list[str]]]:
    """The names and the rows below them: the first line, or the last comment, or numbers of the columns."""
    if not all(_number(cell, comma) is not None for cell in rows[0]):
        return _unique(rows[0]), rows[1:]
    if comments and len(names := _cells(comments[-1].lstrip("#%/ "), separator)) == len(rows[0]):
        return _unique(names), rows
    return [f"column{index + 1}" for index in range(len(rows[0]))], rows


def _load(path: Path, layout: Layout, indices: Sequence[int]) -> dict[str, NDArray[Any]]:
    """The columns of these numbers.  Raises RecordingError."""
    parts: dict[int, list[NDArray[Any]]] = {index: [] for index in indices}
    lines = islice(_lines(path, layout.encoding), layout.skipped, None)
    line, count, most = layout.skipped + 1, 0, max(min(ROWS_AT_ONCE, CELLS_AT_ONCE // len(layout.header)), 1)
    while chunk := list(islice(lines, most)):
        numbered = [(line + i, text) for i, text in enumerate(chunk) if text.strip() and not text.startswith(COMMENT)]
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
    rows = [_cells(text, layout.separator) for _, text in lines]
    if lines and not lines[-1][1].endswith("\n") and not _is_whole(rows[-1], layout, indices):
        rows.pop()
    for index, row in enumerate(rows):
        if len(row) == width or (len(row) > width and not any(cell.strip() for cell in row[width:])):
            continue
        raise RecordingError(
            f"{path}: line {lines[index][0]}: found {len(row)} cells separated by {_called(layout.separator)}, "
            f"expected {width} as in the header"
        )
    return rows


def _is_whole(row: list[str], layout: Layout, indices: Sequence[int]) -> bool:
    """Whether a row without its newline may still be complete."""
    numbers = [index for index in indices if index not in layout.dates]
    return len(row) >= len(layout.header) and all(_number(row[i], layout.decimal_comma) is not None for i in numbers)


def _column(cells: list[str], index: int, layout: Layout, path: Path, lines: Sequence[int]) -> NDArray[Any]:
    if index in layout.dates:
        return np.array([_date(cell) for cell in cells], dtype="datetime64[ns]")
    try:
        if not layout.decimal_comma:
            return np.array([float(cell) if cell else math.nan for cell in cells])
    except ValueError:
        pass
    numbers = [_number(cell, layout.decimal_comma) for cell in cells]
    if None in numbers:
        row = numbers.index(None)
        raise RecordingError(
            f"{path}: line {lines[row]}: found {cells[row][:40]!r} in {shown(layout.header[index])!r}, "
            "expected a number"
        )
    return np.array(numbers, dtype=float)


def _number(cell: str, decimal_comma: bool) -> float | None:
    """NaN for an empty cell, None for a word."""
    if cell.strip().lower() in NOTHING:
        return math.nan
    try:
        return float(cell.replace(",", ".") if decimal_comma else cell)
    except ValueError:
        return None


def _date(cell: str) -> np.datetime64:
    try:
        time = datetime.fromisoformat(cell.strip())
    except ValueError:
        return np.datetime64("NaT", "ns")
    utc = time.astimezone(UTC) if time.tzinfo else time.replace(tzinfo=UTC)
    return np.datetime64(utc.replace(tzinfo=None), "ns")


def _is_date(rows: list[list[str]], index: int) -> bool:
    cells = [row[index] for row in rows if index < len(row) and row[index].strip()]
    return bool(cells) and not np.isnat(_date(cells[-1])) and _number(cells[-1], False) is None


def _is_numeric(rows: list[list[str]], index: int, layout: Layout) -> bool:
    whole = [row for row in rows if len(row) >= len(layout.header)]
    return index in layout.dates or all(_number(row[index], layout.decimal_comma) is not None for row in whole)


def _units(row: list[str], comma: bool) -> list[str]:
    """The units, where the row below the header holds nothing else; [] otherwise."""
    units = [SPELT.get(bare.lower(), bare) for bare in (cell.strip().strip("[]()") for cell in row)]
    known = [unit for unit in units if to_si(unit) is not None]
    return units if known and not any(unit and (_number(unit, comma) is not None) for unit in units) else []


def _separator(line: str) -> str:
    """The one that stands most often outside of quotes; " " where there is none of them."""
    counts = Counter(re.sub(r'"[^"]*"', "", line))
    best = max(SEPARATORS, key=lambda each: counts[each])
    return best if counts[best] else " "


def _cells(line: str, separator: str) -> list[str]:
    if separator == " ":
        return line.split()
    if '"' not in line:
        return line.rstrip("\r\n").split(separator)
    try:
        return next(csv.reader([line], delimiter=separator), [])
    except csv.Error:  # a cell without end
        return [line]


def _unique(names: Sequence[str]) -> list[str]:
    """Each name once: the second of a name gets its number behind it, one without a name that of its column."""
    found: list[str] = []
    taken: set[str] = set()
    for index, name in enumerate(names):
        plain = name.strip() or f"column{index + 1}"
        found.append(plain if plain not in taken else f"{plain} ({index + 1})")
        taken.add(plain)
    return found


def _encoding(path: Path) -> str:
    with path.open("rb") as file:
        start = file.read(LONGEST_LINE)
    if start.startswith((b"\xff\xfe", b"\xfe\xff")):
        return "utf-16"
    if b"\0" in start:
        raise RecordingError(
            f"{path}: found bytes that are no text, expected a recording; is it a file of another kind?"
        )
    try:
        start.decode()
    except UnicodeDecodeError as error:
        return "cp1252" if error.start < len(start) - 4 else "utf-8-sig"
    return "utf-8-sig"


def _lines(path: Path, encoding: str) -> Iterator[str]:
    with path.open(encoding=encoding, errors="replace") as file:
        while line := file.readline(LONGEST + 1):
            if len(line) > LONGEST:
                raise RecordingError(f"{path}: found a line of more than {LONGEST} characters, expected a table")
            yield line


def _called(separator: str) -> str:
    return {",": "commas", ";": "semicolons", "\t": "tabs", "|": "bars", " ": "blanks"}[separator]
