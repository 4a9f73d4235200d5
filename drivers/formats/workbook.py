"""Sheets of Excel and LibreOffice, and archives of NumPy: what a ZIP file may be.

A sheet becomes lines of text, which text_layout.py understands as those of a CSV file.  It is read by python-calamine
in a process of its own (workbook_child.py).
"""

from __future__ import annotations

import zipfile
from pathlib import Path

from lostmotion.drivers.errors import RecordingError
from lostmotion.drivers.formats.arrays import open_numpy
from lostmotion.drivers.formats.child import output_of
from lostmotion.drivers.formats.needed import needed
from lostmotion.drivers.formats.source import reason
from lostmotion.drivers.formats.table import Table
from lostmotion.drivers.formats.text import open_lines
from lostmotion.drivers.formats.vectors import check_size

__all__ = ["open_workbook", "open_zip"]

CONTENTS = {"xl/workbook.xml", "xl/workbook.bin", "content.xml"}
"""one of which a workbook has, if it is a ZIP archive"""


def open_zip(path: Path) -> Table:
    """The sheet with most rows of a workbook, or the arrays of an npz file.  Raises RecordingError."""
    try:
        with zipfile.ZipFile(path) as archive:
            names = set(archive.namelist())
            check_size(str(path), sum(each.file_size for each in archive.infolist()))
    except (zipfile.BadZipFile, OSError, ValueError) as error:
        raise RecordingError(
            f"{path}: found a workbook, ZIP or NumPy archive, which cannot be read: {reason(error)}; save it as CSV"
        ) from error
    if any(name.endswith(".npy") for name in names):
        return open_numpy(path)
    if not names & CONTENTS:
        raise RecordingError(
            f"{path}: found a ZIP archive without a sheet, expected a recording; unpack it, or save it as CSV"
        )
    return open_workbook(path)


def open_workbook(path: Path) -> Table:
    """The sheet with most rows of a workbook.  Raises RecordingError."""
    check_size(str(path), path.stat().st_size)
    needed("python_calamine", path)
    first, *lines = output_of("workbook_child.py", path, "a workbook").decode().splitlines(keepends=True)
    sheet, sheets = first.split()
    return open_lines(str(path), f"workbook, sheet {sheet} of {sheets}", lambda: iter(lines))
