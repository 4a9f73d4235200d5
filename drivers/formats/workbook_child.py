"""Reads a workbook (xlsx, xls, xlsb, ods) in a process of its own, as child.py says: two cells that are far apart ask
for the memory of all between them.

It writes a line with the number of the sheet that has most rows and how many sheets there are, then its rows, their
cells separated by tabs.
"""

from __future__ import annotations

import resource
import sys
from collections import Counter
from collections.abc import Iterable
from datetime import date, datetime, time, timedelta
from typing import Any

MOST_MEMORY = 4_000_000_000


def main(path: str) -> int:
    """The exit status."""
    import python_calamine

    resource.setrlimit(resource.RLIMIT_AS, (MOST_MEMORY, MOST_MEMORY))
    try:
        with python_calamine.load_workbook(path) as book:
            sheets = [_rows(book.get_sheet_by_index(index).iter_rows()) for index in range(len(book.sheet_names))]
    except (Exception, MemoryError) as error:  # noqa: BLE001 - a reader raises almost anything on a damaged file
        sys.stderr.write(f"{type(error).__name__}: {error}")
        return 1
    best = max(sheets, key=len, default=[])
    place = sheets.index(best) + 1 if sheets else 0
    sys.stdout.buffer.write("\n".join([f"{place} {len(sheets)}", *best, ""]).encode(errors="replace"))
    return 0


def _rows(rows: Iterable[list[Any]]) -> list[str]:
    """The rows that are not empty.  Empty cells at their end are left out, beyond the usual width."""
    cells = [[_text(value) for value in row] for row in rows]
    widths = [max((i for i, cell in enumerate(row, start=1) if cell), default=0) for row in cells]
    usual = max(Counter(width for width in widths if width).items(), key=lambda each: each[1], default=(0, 0))[0]
    return ["\t".join(row[: max(width, usual)]) for row, width in zip(cells, widths, strict=True) if width]


def _text(value: Any) -> str:
    """What a cell shows: a text, a number, or a date as in ISO 8601."""
    if isinstance(value, datetime):
        return value.isoformat(sep=" ", timespec="microseconds")
    if isinstance(value, timedelta):
        minutes, seconds = divmod(value.total_seconds(), 60)
        return f"{minutes // 60:02.0f}:{minutes % 60:02.0f}:{seconds:09.6f}"
    if isinstance(value, (date, time)):
        return value.isoformat()
    return repr(value + 0) if isinstance(value, (int, float)) else " ".join(str(value).split())


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
