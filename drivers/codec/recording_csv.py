"""The text of a recording: ``# key = value`` lines, a header, rows.  Text in, columns out, and back.

No file is opened here, and no unit converted.
"""

from __future__ import annotations

import csv
import math
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain, islice
from typing import Any, TextIO

import numpy as np

from lostmotion.drivers import toml_text
from lostmotion.drivers.base import FloatArray
from lostmotion.drivers.errors import RecordingError
from lostmotion.drivers.units import COLUMN_UNITS

__all__ = ["ROWS_AT_ONCE", "Table", "cells", "head_text", "parse", "text_lines"]

ROWS_AT_ONCE = 16384  # bounds the text held in memory while a file of any length is read or written
LARGEST = 1e30
"""in a cell, in any unit; sums of squares of such numbers are finite"""
LONGEST_LINE = 100_000
"""characters; a thousand columns take a fifth of it"""
CUT = '"'  # no number: stands for what was cut off


@dataclass(frozen=True, slots=True)
class Table:
    """The content of a recording, in the units of the file.

    columns: the numbers of the columns that the format knows, shape (N,) each, NaN where a cell is empty; metadata;
    extra: the other columns, as text; truncated: whether an incomplete last line was left out; first_line: the number
    of the first row's line in the file.
    """

    columns: dict[str, FloatArray]
    metadata: dict[str, Any]
    extra: dict[str, list[str]]
    truncated: bool
    first_line: int


def parse(lines: Iterator[str], name: str, *, ends_in_newline: bool) -> Table:
    """Reads the text.  ``name`` is for errors; raises RecordingError."""
    metadata, header_text, header_line = _head(lines, name)
    table = _rows(chain([header_text], lines), name, header_line, ends_in_newline=ends_in_newline)
    header = _header(next(table), f"{name}: line {header_line}")
    numbers: dict[str, list[FloatArray]] = {column: [] for column in header if column in COLUMN_UNITS}
    extra: dict[str, list[str]] = {column: [] for column in header if column not in COLUMN_UNITS}
    truncated = False
    line = header_line + 1
    for rows, is_last in _chunks(table):
        if is_last and not ends_in_newline and rows and not _is_whole(rows[-1], header):
            rows.pop()
            truncated = True
        texts = _transposed(rows, header, name, line)
        for column, parts in numbers.items():
            parts.append(_numbers(texts[column], column, name, line))
        for column, kept in extra.items():
            kept += texts[column]
        line += len(rows)
    columns = {column: np.concatenate(parts) for column, parts in numbers.items()}
    return Table(columns, metadata, extra, truncated, header_line + 1)


def text_lines(file: TextIO, name: str) -> Iterator[str]:
    """The lines of a file.  Raises RecordingError for one without an end, as a device's."""
    while line := file.readline(LONGEST_LINE + 1):
        if len(line) > LONGEST_LINE:
            raise RecordingError(
                f"{name}: found a line of more than {LONGEST_LINE} characters, expected a recording; is it one?"
            )
        yield line


def _head(lines: Iterator[str], name: str) -> tuple[dict[str, Any], str, int]:
    """The metadata, and the header with its line number."""
    settings = []
    for number, text in enumerate(lines, start=1):
        if text.startswith("#"):
            settings.append(_checked_setting(text[1:].strip(), f"{name}: line {number}"))
        elif text.strip():
            try:
                return toml_text.loads("\n".join(settings)), text, number
            except toml_text.TomlError as error:
                raise RecordingError(
                    f"{name}: the '#' lines do not go together: {error}; is a key there twice?"
                ) from error
    raise RecordingError(f"{name}: found no header, expected a line such as 'time,accel'; the file is empty")


def _checked_setting(text: str, where: str) -> str:
    try:
        toml_text.loads(text)
    except toml_text.TomlError as error:
        raise RecordingError(
            f'{where}: found {text[:60]!r}, expected key = value in TOML ({error}); does a text lack its "quotes"?'
        ) from error
    return text


def _header(row: list[str], where: str) -> list[str]:
    header = [cell.strip() for cell in row]
    shown = ",".join(header)[:80]
    if all(_is_number(cell) for cell in header):
        raise RecordingError(f"{where}: found {shown!r}, expected a header such as 'time,accel'; the header is missing")
    if "time" not in header:
        raise RecordingError(
            f"{where}: found the columns {shown!r}, expected one called 'time'; "
            "is it a recording of another program, or not separated by commas?"
        )
    twice = sorted(column for column, times in Counter(header).items() if times > 1)
    if twice:
        raise RecordingError(f"{where}: found the column {twice[0]!r} twice, expected each once; rename one of them")
    return header


def _rows(lines: Iterable[str], name: str, first_line: int, *, ends_in_newline: bool) -> Iterator[list[str]]:
    """Rows of text; in place of a last line that was cut off within a quote, one that is not whole."""
    reader = csv.reader(lines, strict=True)
    read = 0
    try:
        for row in reader:
            yield row
            read = reader.line_num
    except csv.Error as error:
        if not ends_in_newline and reader.line_num == read + 1 and "unexpected end" in str(error):
            yield [CUT]
            return
        raise RecordingError(
            f"{name}: line {first_line + read}: found {error}, expected comma-separated numbers; "
            "is a quote not closed, or is it no text?"
        ) from error


def _chunks(reader: Iterator[list[str]]) -> Iterator[tuple[list[list[str]], bool]]:
    """Rows of text, some at a time, and whether they are the last; blank lines at the end are left out."""
    rows = list(islice(reader, ROWS_AT_ONCE))
    while len(following := list(islice(reader, ROWS_AT_ONCE))) == ROWS_AT_ONCE or any(following):
        yield rows, False
        rows = following
    while rows and not rows[-1]:
        rows.pop()
    yield rows, True


def _transposed(rows: list[list[str]], header: list[str], name: str, line: int) -> dict[str, tuple[str, ...]]:
    width = len(header)
    if any(len(row) != width for row in rows):
        index = next(i for i, row in enumerate(rows) if len(row) != width)
        raise RecordingError(
            f"{name}: line {line + index}: found {len(rows[index])} cells, expected {width} as in the header; "
            "is a comma missing, or used as a decimal point?"
        )
    columns: Iterable[tuple[str, ...]] = zip(*rows, strict=True) if rows else ((),) * width
    return dict(zip(header, columns, strict=True))


def _numbers(cells: Sequence[str], column: str, name: str, line: int) -> FloatArray:
    try:
        numbers = np.array([float(cell) if cell else math.nan for cell in cells])
    except ValueError:
        index = next((i for i, cell in enumerate(cells) if cell.strip() and not _is_number(cell)), None)
        if index is not None:
            raise _bad_cell(cells[index], column, f"{name}: line {line + index}") from None
        numbers = np.array([float(cell) if cell.strip() else math.nan for cell in cells])  # blanks in an empty cell
    beyond = np.flatnonzero(np.abs(numbers) > LARGEST)  # not so of NaN: an empty cell
    if beyond.size:
        raise _bad_cell(cells[beyond[0]], column, f"{name}: line {line + beyond[0]}")
    return numbers


def _bad_cell(cell: str, column: str, where: str) -> RecordingError:
    return RecordingError(
        f"{where}: found {cell[:40]!r} in the column {column!r}, expected a finite number up to {LARGEST:g}; "
        "is a decimal comma or a word in it, or did a division by zero make it?"
    )


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _is_whole(row: list[str], header: list[str]) -> bool:
    """Whether a row without its newline may still be complete."""
    return len(row) == len(header) and all(
        not cell.strip() or _is_number(cell) for column, cell in zip(header, row, strict=True) if column in COLUMN_UNITS
    )


def head_text(metadata: Mapping[str, Any]) -> str:
    """The ``# key = value`` lines of a recording."""
    return "".join(f"# {toml_text.toml_key(key)} = {toml_text.toml_value(value)}\n" for key, value in metadata.items())


def cells(values: FloatArray) -> list[float | str]:
    """A column as csv.writer takes it: floats, which it writes so that they read back the same, empty for NaN."""
    return ["" if value != value else value for value in values.tolist()]
