"""How a table as text of another program is laid out: separator, decimal comma, header, units, dates.

The rows of numbers are found first, by what separates most of their cells into numbers; what stands above them is a
line of units, the names of the columns, or a title.  The columns are read by text.py.
"""

from __future__ import annotations

import csv
import re
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from lostmotion.drivers.codec.recording_csv import LONGEST_LINE
from lostmotion.drivers.errors import RecordingError
from lostmotion.drivers.formats.cells import date, is_date, number
from lostmotion.drivers.formats.preamble import LONGEST_NAME, are_settings, rate_above
from lostmotion.drivers.formats.source import MOST_SERIES, too_many
from lostmotion.drivers.formats.words import SPELT, column_of, is_time, speed_of
from lostmotion.drivers.toml_text import TomlError, loads
from lostmotion.drivers.units import to_si

__all__ = [
    "LOOKED_AT",
    "MOST_BROKEN",
    "SEPARATORS",
    "Layout",
    "Lines",
    "called",
    "cells_of",
    "is_row",
    "layout_of",
    "lines_of",
]

SEPARATORS = ";\t|, "
"""those first that are taken where several separate as many numbers: a comma may be a decimal one, a blank padding"""
COMMENT = ("#", "%", "//")
LOOKED_AT = 200
"""rows, to distinguish numbers from words"""
MOST_BROKEN = 0.05
"""share of the rows that may be none, as where a serial line was cut off or a program speaks in between"""
LONGEST = 100 * LONGEST_LINE
"""of a line; MOST_SERIES names of 100 characters are a tenth of it"""
RULER = re.compile(r"[\s+|]*[-=]{3}[-=+|\s]*")
"""a line below the header, drawn with signs"""
LABEL = re.compile(r"^\w+:\s+")
"""before the names of the columns in a comment: ``# Columns: t q tau``"""
OPENED = re.compile(r"^\s*(?:\w+\s*=\s*)?\[")
"""how a matrix begins"""
MATRIX = re.compile(rf"{OPENED.pattern}|[\];]\s*$")
"""how its first row begins, or any of its rows ends"""
NAME = re.compile(r"[^\s(\[]\S*(?:\s*[(\[][^)\]]*[)\]])?")
"""among names that blanks separate, one with its unit in brackets"""

TITLES = {"unit", "units", "y_unit_label"}
"""what the line of units begins with, perhaps for each signal beside its times: ``Unit,V,Unit,V``; the last one in a
measurement of LabVIEW (.lvm)"""
FAR = re.compile(r"\s{2,}|\t")
"""between names that hold blanks themselves: ``Sample   Commanded Pos   Control Effort``"""

Lines = Callable[[], Iterator[str]]
"""reads the lines of a table from its beginning"""


@dataclass(frozen=True, slots=True)
class Layout:
    """separator: " " for any blanks; header: the names; units: of a line below it, "" for none; skipped: lines before
    the rows; metadata: of ``# key = value`` lines, as in lostmotion's own files; rate: ``rate_above`` the rows."""

    separator: str
    header: Sequence[str]
    units: Sequence[str]
    skipped: int
    decimal_comma: bool
    dates: frozenset[int]
    metadata: Mapping[str, Any]
    rate: tuple[str, float] = ("", 0.0)


@dataclass(frozen=True, slots=True)
class Rows:
    """Lines as the rows of a table: cells of each line, and how many most lines have; numeric: the columns of numbers
    or dates."""

    separator: str
    comma: bool
    cells: list[list[str]]
    width: int
    numeric: frozenset[int]

    def first(self) -> int:
        """The first line that is a row of numbers; separators alone are an empty line of a sheet."""
        found = [i for i, row in enumerate(self.cells) if self.is_row(row)]
        return next((i for i in found if any(self.cells[i][k].strip() for k in self.numeric)), found[0])

    def is_row(self, row: Sequence[str]) -> bool:
        return len(row) == self.width and all(_is_value(row[i], self.comma) for i in self.numeric)


def layout_of(name: str, lines: Lines) -> tuple[Layout, list[list[str]]]:
    """How the text is laid out, and its first rows.  Raises RecordingError."""
    numbered = list(enumerate(islice(lines(), 4 * LOOKED_AT), start=1))
    held = [(place, line) for place, line in numbered if is_row(line)][: 2 * LOOKED_AT]
    if not held:
        raise RecordingError(f"{name}: found no rows, expected a table of numbers with a header; the file is empty")
    rows = _rows([line for _, line in held])
    first = rows.first() if rows.numeric else 1
    before = held[first][0] - 1 if first < len(held) else held[-1][0]
    comments = [line for place, line in numbered if line.lstrip().startswith(COMMENT) and place <= before]
    above = held[:first]
    if len(above) > 1 and are_settings(above[-2][1], above[-1][1]):
        above = above[:-2]
    header, units = _above(above, before, comments, rows)
    if len(header) > MOST_SERIES:
        raise too_many(name, len(header), "columns")
    kept = rows.cells[first:] if held[-1][1].endswith("\n") else rows.cells[first:-1]
    dates = frozenset(i for i in range(len(header)) if is_date(kept, i, rows.comma))
    rate = rate_above([line for place, line in numbered if place <= before])
    layout = Layout(rows.separator, header, units, before, rows.comma, dates, _metadata(comments), rate)
    return layout, [row for row in kept if len(row) >= len(header)]


def _rows(lines: list[str]) -> Rows:
    """The lines separated by the sign, and with the decimal sign, that makes most numbers of them."""
    found = [_separated(lines, separator, comma) for separator in SEPARATORS for comma in (False, True)]
    best = max(found, key=_score)
    return best if best.numeric else _separated(lines, _separator(lines[0]), False)


def _score(rows: Rows) -> int:
    """How many cells are numbers, less those of columns that are not; one column is no table, if there is another."""
    whole = sum(len(row) == rows.width for row in rows.cells)
    return whole * (2 * len(rows.numeric) - rows.width) if rows.width > 1 else 0


def _separated(lines: list[str], separator: str, comma: bool) -> Rows:
    cells = [cells_of(line, separator) for line in lines]
    used = max((at for row in cells for at, cell in enumerate(row, start=1) if cell.strip()), default=1)
    cells = [row[:used] for row in cells]  # a separator at the end of every line makes no column
    body = cells[len(cells) // 2 :] or cells
    counts = Counter(len(row) for row in body)
    width = max(counts, key=lambda each: (counts[each], each))
    whole = [row for row in body if len(row) == width]
    least = (1 - MOST_BROKEN) * len(whole)
    numeric = [i for i in range(width) if sum(_is_value(row[i], comma) for row in whole) >= least]
    is_empty = not any(row[i].strip() for row in whole for i in numeric)
    return Rows(separator, comma, cells, width, frozenset() if is_empty else frozenset(numeric))


def _is_value(cell: str, comma: bool) -> bool:
    """Whether a cell is a number, or empty, or a date."""
    return number(cell, comma) is not None or (":" in cell and not np.isnat(date(cell)))


def _above(above: list[tuple[int, str]], before: int, comments: list[str], rows: Rows) -> tuple[list[str], list[str]]:
    """The names of the columns and their units, of the numbered lines above the rows; before: how many all are."""
    width = rows.width
    found = [_names(line, before - place, rows) for place, line in above[-3:]]
    units = _units(found[-1], rows.comma) if found and found[-1] else []
    if units and len(found) > 1 and found[-2]:  # else these are names, too: of t, rad, error
        found, units = found[:-1], [*units, *[""] * width][:width]
    else:
        units = []
    if names := next((names for names in reversed(found[-2:]) if names), []):
        return _named_below(_timed(names, units), units) if units else (_unique(names), _titled(above, rows))
    units = _units(_names_in(above[-1][1], rows), rows.comma) if above else []
    header, below = _commented(comments, rows)
    return header, [*(below or units), *[""] * width][:width]


def _titled(above: list[tuple[int, str]], rows: Rows) -> list[str]:
    """The units in the last line above the rows that says so in its first cell, and has one for each other column;
    none where there is no such line."""
    lines = ([cell.strip() for cell in cells_of(line.rstrip(), rows.separator)] for _, line in reversed(above))
    said = (cells for cells in lines if cells[0].lower() in TITLES and len(cells) == rows.width)
    return next((units for cells in said if (units := _units(cells, rows.comma))), [""] * rows.width)


def _timed(names: list[str], units: list[str]) -> list[str]:
    """The names of the columns, where none is a time, with ``time`` for the one without a name whose unit is that of a
    time."""
    of_time = [not name.strip() and (to_si(unit) or ("",))[0] == "s" for name, unit in zip(names, units, strict=True)]
    if sum(of_time) != 1 or any(map(is_time, names)):
        return names
    return ["time" if is_one else name for name, is_one in zip(names, of_time, strict=True)]


def _named_below(names: list[str], units: list[str]) -> tuple[list[str], list[str]]:
    """The names of the columns and their units, where some cells of the line of units are quantities instead: of
    ``Time, Analog 1`` above ``ms, Servo motor speed`` the second."""
    is_quantity = [
        to_si(below) is None and _is_quantity(below) and not (is_time(name) or _is_quantity(name))
        for name, below in zip(names, units, strict=True)
    ]
    kept = [below if is_one else name for name, below, is_one in zip(names, units, is_quantity, strict=True)]
    return _unique(kept), ["" if is_one else below for below, is_one in zip(units, is_quantity, strict=True)]


def _is_quantity(name: str) -> bool:
    """Whether a name says what a column holds."""
    return column_of(name) is not None or speed_of(name) is not None


def _names(line: str, below: int, rows: Rows) -> list[str]:
    """The names of all columns in a line, with so many lines between it and the rows; [] where it holds others."""
    names, width = _filled(_names_in(line, rows), rows), rows.width
    is_header = len(names) >= width and _are_words(names, rows.comma) and not _is_title(line, rows.separator, below)
    return names[:width] if is_header else []


def _filled(names: list[str], rows: Rows) -> list[str]:
    """The names with an empty one for each of the columns beside them, as of a calculation in a sheet; the names
    themselves where blanks separate, or none of them is the time or a column."""
    is_short = 1 < len(names) < rows.width and rows.separator != " "
    are_known = is_short and any(is_time(name) or column_of(name) for name in names)
    return names + [""] * (rows.width - len(names)) if are_known else names


def _names_in(line: str, rows: Rows) -> list[str]:
    """The cells of a line above the rows, by their sign, or by another one where that gives too few."""
    found = cells_of(line, rows.separator)
    if rows.separator == " " and len(found) > rows.width:
        joined = (NAME.findall(line), FAR.split(line.strip()))
        return next((names for names in joined if len(names) == rows.width), found)
    while len(found) > rows.width and not found[-1].strip():
        found.pop()
    if len(found) >= rows.width and (rows.width == 1 or any(cell.strip() for cell in found[1:])):
        return found
    others = (
        NAME.findall(line) if sign == " " else cells_of(line, sign) for sign in SEPARATORS if sign != rows.separator
    )
    return next((cells for cells in others if len(cells) == rows.width), found)


def _is_title(line: str, separator: str, below: int) -> bool:
    """Whether words that blanks separate are a title: lines follow before the rows, and none of them names a column."""
    return below > 0 and separator == " " and not any(is_time(word) or column_of(word) for word in line.split())


def _are_words(cells: list[str], comma: bool) -> bool:
    """Whether cells may be names: none is a number, and one is not empty."""
    named = [cell for cell in cells if cell.strip()]
    return bool(named) and not any(number(cell, comma) is not None for cell in named)


def _commented(comments: list[str], rows: Rows) -> tuple[list[str], list[str]]:
    """Names, and units below them, of the last comments that have as many cells as the rows, or fewer, of which one is
    the time or a column; or numbers of columns.  A comment within a comment, as of the date, ends the names."""
    plain = [re.split(r"[\t ]+%|[\t ]+#", line.lstrip().lstrip("#%/ ").rstrip(), maxsplit=1)[0] for line in comments]
    above = [_filled(_names_in(line, rows), rows) for line in (LABEL.sub("", line) for line in plain)]
    above = [cells for cells in above if len(cells) == rows.width and _may_be_names(cells, rows.comma)][-2:]
    if len(above) == 2 and all(re.fullmatch(r"\[.*\]|\(.*\)", cell.strip()) for cell in above[1]):
        return _unique(above[0]), _units(above[1], rows.comma)
    known = [cells for cells in above if any(is_time(cell) or column_of(cell) for cell in cells)] or above
    return _unique(known[-1]) if known else [f"column{index + 1}" for index in range(rows.width)], []


def _may_be_names(cells: list[str], comma: bool) -> bool:
    """Whether all cells of a comment may be names or units, but for columns without one at the end: short, and no
    numbers."""
    named = [cell.strip() for cell in cells if cell.strip()]
    are_first = all(cell.strip() for cell in cells[: len(named)])
    return are_first and all(len(cell) < LONGEST_NAME and number(cell, comma) is None for cell in named)


def is_row(line: str) -> bool:
    """Whether a line is neither empty, nor a comment, nor drawn."""
    return bool(line.strip()) and not line.lstrip().startswith(COMMENT) and not RULER.fullmatch(line)


def _metadata(comments: list[str]) -> dict[str, Any]:
    """The comments of the form ``key = value``; others are ignored."""
    metadata: dict[str, Any] = {}
    for line in comments:
        with suppress(TomlError):
            metadata.update(loads(line.lstrip("#").strip()))
    return metadata


def _units(row: list[str], comma: bool) -> list[str]:
    """The units, where a row holds nothing else but its title; [] otherwise."""
    bare = [cell.strip().strip("[]()") for cell in row]
    units = ["" if unit.lower() in TITLES else SPELT.get(unit.lower(), unit) for unit in bare]
    known = [unit for unit in units if to_si(unit) is not None]
    return units if known and not any(unit and (number(unit, comma) is not None) for unit in units) else []


def _separator(line: str) -> str:
    """The one that stands most often outside of quotes; " " where there is none of them."""
    counts = Counter(re.sub(r'"[^"]*"', "", line))
    best = max(SEPARATORS.strip(" "), key=lambda each: counts[each])
    return best if counts[best] else " "


def cells_of(line: str, separator: str) -> list[str]:
    if ("[" in line or "]" in line or ";" in line) and MATRIX.search(line):  # most rows have none of these
        line = _without_signs(line, separator)
    if separator == " ":
        return line.split()
    if '"' not in line:
        return line.rstrip("\r\n").split(separator)
    try:
        return next(csv.reader([line], delimiter=separator), [])
    except csv.Error:  # a cell without end
        return [line]


def _without_signs(line: str, separator: str) -> str:
    """A row without the signs with which programs write a matrix: ``[`` before the first row, ``;`` behind each, if
    nothing else stands between semicolons, and ``]`` behind the last one."""
    plain = line.rstrip()
    if separator != ";" and ";" not in (less := plain.removesuffix(";")):
        plain = less.rstrip()
    if "[" in plain and "]" not in plain:
        plain = OPENED.sub("", plain)
    return plain.removesuffix("]") if "[" not in plain else plain


def _unique(names: Sequence[str]) -> list[str]:
    """Each name once: the second of a name gets its number behind it, one without a name that of its column."""
    found: list[str] = []
    taken: set[str] = set()
    for index, name in enumerate(names):
        plain = name.strip() or f"column{index + 1}"
        found.append(plain if plain not in taken else f"{plain} ({index + 1})")
        taken.add(plain)
    return found


def lines_of(path: Path) -> Lines:
    """The lines of a file.  Raises RecordingError."""
    return partial(_lines, path, _encoding(path))


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


def called(separator: str) -> str:
    return {",": "commas", ";": "semicolons", "\t": "tabs", "|": "bars", " ": "blanks"}[separator]
