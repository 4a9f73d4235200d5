"""Sheets of Excel and LibreOffice (xlsx), and archives of NumPy: what a ZIP file may be.

A sheet becomes lines of text, which text_layout.py understands as those of a CSV file.  Only the standard library is
used: a workbook is a few XML files, of which cells with their values are needed.
"""

from __future__ import annotations

import re
import zipfile
from collections.abc import Iterator
from datetime import datetime, timedelta
from pathlib import Path
from xml.etree import ElementTree

from lostmotion.drivers.errors import RecordingError
from lostmotion.drivers.formats.arrays import open_numpy
from lostmotion.drivers.formats.source import reason
from lostmotion.drivers.formats.table import Table
from lostmotion.drivers.formats.text import open_lines
from lostmotion.drivers.formats.vectors import check_size

__all__ = ["open_zip"]

SHEET = re.compile(r"xl/worksheets/sheet(\d+)\.xml")
BUILT_IN_DATES = {*range(14, 23), *range(45, 48)}
"""numbers of formats of dates and times that no workbook defines (ECMA-376, 18.8.30)"""
FIRST_DAY = datetime(1899, 12, 30)
"""day 0 of a sheet"""
WIDEST = 16384
"""columns of a sheet"""


def open_zip(path: Path) -> Table:
    """The sheet with most rows of a workbook, or the arrays of an npz file.  Raises RecordingError."""
    try:
        with zipfile.ZipFile(path) as archive:
            names = archive.namelist()
            check_size(str(path), sum(each.file_size for each in archive.infolist()))
            sheets = sorted((int(found[1]), name) for name in names if (found := SHEET.fullmatch(name)))
            texts, dates = _shared(archive), _date_styles(archive)
            rows = [_rows(archive, name, texts, dates) for _, name in sheets]
    except (zipfile.BadZipFile, ElementTree.ParseError, OSError, ValueError, KeyError, IndexError) as error:
        raise RecordingError(
            f"{path}: found Excel, ZIP or NumPy archive, which cannot be read: {reason(error)}; save a sheet as CSV"
        ) from error
    if any(name.endswith(".npy") for name in names):
        return open_numpy(path)
    if not rows:
        raise RecordingError(
            f"{path}: found a ZIP archive without a sheet of Excel, expected a recording; unpack it, or save it as CSV"
        )
    lines = max(rows, key=len)
    return open_lines(str(path), f"Excel, sheet {rows.index(lines) + 1} of {len(rows)}", lambda: iter(lines))


def _rows(archive: zipfile.ZipFile, sheet: str, texts: list[str], dates: set[int]) -> list[str]:
    """The rows of a sheet, their cells separated by tabs; texts, dates: those of the workbook."""
    lines = []
    with archive.open(sheet) as file:
        for _, element in ElementTree.iterparse(file):
            if _tag(element) == "row":
                lines.append("\t".join(_cells(element, texts, dates)) + "\n")
                element.clear()
    return lines


def _cells(row: ElementTree.Element, texts: list[str], dates: set[int]) -> list[str]:
    """The cells of a row, with empty ones where the sheet leaves them out."""
    cells: list[str] = []
    for cell in row:
        letters = re.match("[A-Z]+", cell.get("r", ""))
        place = _column(letters[0]) if letters else len(cells)
        if place < WIDEST:
            cells += [""] * (place + 1 - len(cells))
            cells[place] = " ".join(_text(cell, texts, dates).split())
    return cells


def _column(letters: str) -> int:
    """The index of the column A, B, … Z, AA, …"""
    place = 0
    for letter in letters[:4]:
        place = 26 * place + ord(letter) - ord("A") + 1
    return place - 1


def _text(cell: ElementTree.Element, texts: list[str], dates: set[int]) -> str:
    """What a cell shows: a text, a number, or a date as in ISO 8601."""
    kind = cell.get("t", "n")
    if kind == "inlineStr":
        return _joined(cell)
    value = next((each.text or "" for each in cell if _tag(each) == "v"), "")
    if kind == "s" and value:
        return texts[int(value)]
    if kind == "e":
        return ""
    return _date(float(value)) if kind == "n" and value and int(cell.get("s", 0)) in dates else value


def _date(days: float) -> str:
    """A date of a sheet; a time of day where it is less than a day."""
    time = FIRST_DAY + timedelta(days=days)
    return time.isoformat(sep=" ", timespec="microseconds") if days >= 1 else time.strftime("%H:%M:%S.%f")


def _shared(archive: zipfile.ZipFile) -> list[str]:
    """The texts of a workbook, which its cells number."""
    return [_joined(each) for each in _all(archive, "xl/sharedStrings.xml", "si")]


def _date_styles(archive: zipfile.ZipFile) -> set[int]:
    """The styles of cells that show a number as a date or time."""
    formats = {
        int(each.get("numFmtId", 0)): each.get("formatCode", "") for each in _all(archive, "xl/styles.xml", "numFmt")
    }
    plain = {number: re.sub(r'"[^"]*"|\[[^\]hms]*\]|\\.', "", code) for number, code in formats.items()}
    own = {
        number for number, code in plain.items() if re.search("[dhmsy]", code, re.IGNORECASE) and "General" not in code
    }
    styles = [cell for group in _all(archive, "xl/styles.xml", "cellXfs") for cell in group]
    return {i for i, each in enumerate(styles) if int(each.get("numFmtId", 0)) in BUILT_IN_DATES | own}


def _all(archive: zipfile.ZipFile, name: str, tag: str) -> Iterator[ElementTree.Element]:
    """The elements of this name in a file of the archive, none where it lacks the file."""
    if name in archive.namelist():
        yield from (each for each in ElementTree.fromstring(archive.read(name)).iter() if _tag(each) == tag)


def _tag(element: ElementTree.Element) -> str:
    return element.tag.rpartition("}")[2]


def _joined(element: ElementTree.Element) -> str:
    return "".join(each.text or "" for each in element.iter() if _tag(each) == "t")
