"""How a table as text of another program is laid out: separator, decimal comma, header, units, dates.

A header may stand behind ``#``, and a line of units below it.  The columns are read by text.py.
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

from lostmotion.drivers.codec.recording_csv import LONGEST_LINE
from lostmotion.drivers.errors import RecordingError
from lostmotion.drivers.formats.source import MOST_SERIES, too_many
from lostmotion.drivers.formats.words import SPELT, is_time
from lostmotion.drivers.toml_text import TomlError, loads
from lostmotion.drivers.units import to_si

__all__ = ["Layout", "called", "cells_of", "date", "is_row", "layout_of", "lines_of", "number"]

SEPARATORS = ",;\t|"
COMMENT = ("#", "%", "//")
LOOKED_AT = 200
"""rows, to distinguish numbers from words"""
MOST_TITLES = 5
"""lines above the header"""
LONGEST_NAME = 60
"""characters of a name in a comment, which may also be a sentence with commas"""
LONGEST = 100 * LONGEST_LINE
"""of a line; MOST_SERIES names of 100 characters are a tenth of it"""
NOTHING = {"", "nan", "null", "none", "na", "n/a", "-", "--", "?"}
"""cells that stand for no number, in lower case"""
RULER = re.compile(r"[\s+|]*[-=]{3}[-=+|\s]*")
"""a line below the header, drawn with signs"""
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


def layout_of(path: Path) -> tuple[Layout, list[list[str]]]:
    """How the text is laid out, and its first rows.  Raises RecordingError."""
    encoding = _encoding(path)
    comments: list[str] = []
    lines: list[str] = []
    places: list[int] = []
    for place, line in enumerate(islice(lines_of(path, encoding), 4 * LOOKED_AT), start=1):
        if not lines and line.startswith(COMMENT):
            comments.append(line)
        elif is_row(line) and len(lines) < LOOKED_AT:
            lines.append(line)
            places.append(place)
    if not lines:
        raise RecordingError(f"{path}: found no rows, expected a table of numbers with a header; the file is empty")
    titles = _titles(lines)
    lines, places = lines[titles:], places[titles:]
    separator = _separator(lines[0])
    comma = separator != "," and any(DECIMAL_COMMA.fullmatch(cell) for cell in cells_of(lines[-1], separator))
    rows = [cells_of(line, separator) for line in lines]
    header, rows = _header(comments, rows, separator, comma)
    header = header[: _most_cells(rows) or None]
    if len(header) > MOST_SERIES:
        raise too_many(str(path), len(header), "columns")
    units = _units(rows[0], comma) if rows else []
    dates = frozenset(index for index, name in enumerate(header) if is_time(name) and _is_date(rows, index))
    before = len(lines) - len(rows) + bool(units)
    skipped = places[before - 1] if before else places[0] - 1
    below = [*units, *[""] * len(header)][: len(header)]
    layout = Layout(encoding, separator, header, below, skipped, comma, dates, _metadata(comments))
    whole = rows if lines[-1].endswith("\n") else rows[:-1]
    return layout, whole[1:] if units else whole


def _titles(lines: list[str]) -> int:
    """How many lines stand above the names of the columns, which are words, as many as a row below has cells."""
    for above, line in enumerate(lines[:MOST_TITLES]):
        separator = _separator(line)
        names, row = cells_of(line, separator), cells_of(lines[len(lines) // 2], separator)
        are_words = all(number(cell, separator != ",") is None for cell in names if cell.strip())
        if 1 < len(names) == len(row) and (are_words or not above):
            return above
    return _titles_alone(lines)


def _titles_alone(lines: list[str]) -> int:
    """How many lines stand above the first numbers, where none of them names columns: each is one cell by the sign
    that separates the numbers."""
    for above, line in enumerate(lines[: MOST_TITLES + 1]):
        separator = _separator(line)
        row = cells_of(line, separator)
        if len(row) > 1 and all(number(cell, separator != ",") is not None for cell in row):
            return above if all(len(cells_of(title, separator)) == 1 for title in lines[:above]) else 0
    return 0


def _most_cells(rows: list[list[str]]) -> int:
    """How many cells all rows have, of which a header may name more; 0 where they differ."""
    counts = {len(row) for row in rows[:-1]}
    return counts.pop() if len(counts) == 1 else 0


def is_row(line: str) -> bool:
    """Whether a line is neither empty, nor a comment, nor drawn."""
    return bool(line.strip()) and not line.startswith(COMMENT) and not RULER.fullmatch(line)


def _metadata(comments: list[str]) -> dict[str, Any]:
    """The comments of the form ``key = value``; others are ignored."""
    metadata: dict[str, Any] = {}
    for line in comments:
        with suppress(TomlError):
            metadata.update(loads(line.lstrip("#").strip()))
    return metadata


def _header(
    comments: list[str], rows: list[list[str]], separator: str, comma: bool
) -> tuple[list[str], list[list[str]]]:
    """The names and the rows below them: the first line, or the last comment (the one before, where that holds units),
    or numbers of the columns."""
    if not all(number(cell, comma) is not None for cell in rows[0]):
        return _unique(rows[0]), rows[1:]
    above = [cells_of(line.lstrip("#%/ "), separator) for line in comments]
    above = [cells for cells in above if len(cells) == len(rows[0]) and _are_names(cells, comma)][-2:]
    if len(above) == 2 and all(re.fullmatch(r"\[.*\]|\(.*\)", cell.strip()) for cell in above[1]):
        return _unique(above[0]), [above[1], *rows]
    if above:
        return _unique(above[-1]), rows
    return [f"column{index + 1}" for index in range(len(rows[0]))], rows


def _are_names(cells: list[str], comma: bool) -> bool:
    """Whether all cells of a comment may be names or units: short, and no numbers."""
    return all(cell.strip() and len(cell) < LONGEST_NAME and number(cell, comma) is None for cell in cells)


def number(cell: str, decimal_comma: bool) -> float | None:
    """NaN for an empty cell, None for a word."""
    if cell.strip().lower() in NOTHING:
        return math.nan
    try:
        return float(cell.replace(",", ".") if decimal_comma else cell)
    except ValueError:
        return None


def date(cell: str) -> np.datetime64:
    try:
        time = datetime.fromisoformat(cell.strip())
    except ValueError:
        return np.datetime64("NaT", "ns")
    utc = time.astimezone(UTC) if time.tzinfo else time.replace(tzinfo=UTC)
    return np.datetime64(utc.replace(tzinfo=None), "ns")


def _is_date(rows: list[list[str]], index: int) -> bool:
    cells = [row[index] for row in rows if index < len(row) and row[index].strip()]
    return bool(cells) and not any(np.isnat(date(cell)) or number(cell, False) is not None for cell in cells)


def _units(row: list[str], comma: bool) -> list[str]:
    """The units, where the row below the header holds nothing else; [] otherwise."""
    units = [SPELT.get(bare.lower(), bare) for bare in (cell.strip().strip("[]()") for cell in row)]
    known = [unit for unit in units if to_si(unit) is not None]
    return units if known and not any(unit and (number(unit, comma) is not None) for unit in units) else []


def _separator(line: str) -> str:
    """The one that stands most often outside of quotes; " " where there is none of them."""
    counts = Counter(re.sub(r'"[^"]*"', "", line))
    best = max(SEPARATORS, key=lambda each: counts[each])
    return best if counts[best] else " "


def cells_of(line: str, separator: str) -> list[str]:
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


def lines_of(path: Path, encoding: str) -> Iterator[str]:
    with path.open(encoding=encoding, errors="replace") as file:
        while line := file.readline(LONGEST + 1):
            if len(line) > LONGEST:
                raise RecordingError(f"{path}: found a line of more than {LONGEST} characters, expected a table")
            yield line


def called(separator: str) -> str:
    return {",": "commas", ";": "semicolons", "\t": "tabs", "|": "bars", " ": "blanks"}[separator]
