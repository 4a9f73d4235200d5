"""What goes to stdout: one JSON document, or text and tables for people; the errors of files that cannot be written.
Nothing is computed here."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from itertools import chain
from pathlib import Path
from typing import Any

import msgspec

from lostmotion.drivers.errors import LostmotionError, unwritable
from lostmotion.drivers.pipes import STANDARD
from lostmotion.drivers.terminal import column_widths, printable, records
from lostmotion.drivers.units import ARC_MINUTES

__all__ = [
    "OutputError",
    "arcmin",
    "bar",
    "counted",
    "number",
    "print_json",
    "print_json_list",
    "print_lines",
    "print_long_table",
    "print_markup",
    "print_plot",
    "print_table",
    "refuse_existing",
    "write_new",
    "writing",
]

MOST_IN_COLOUR = 500
"""Rows of a table that a person looks at; more are for paging and searching."""
Row = Sequence[str]


class OutputError(LostmotionError):
    """A file cannot be written."""


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """What keeps a file from being written in this block, in one line.  Raises OutputError."""
    try:
        yield
    except OSError as error:
        raise OutputError(unwritable(path, error)) from error


def refuse_existing(path: Path, advice: str = "take another name, or move this one away") -> None:
    """Nothing is written over.  Raises OutputError."""
    if path.exists():
        raise OutputError(f"{path}: found a file, expected a new one; {advice}")


def write_new(path: Path, text: str, *advice: str) -> None:
    """A file that must not exist yet; advice: as for ``refuse_existing``.  Raises OutputError."""
    if path == STANDARD:
        raise OutputError("-o: found -, expected the name of a file: what it gets is printed in any case")
    refuse_existing(path, *advice)
    with writing(path), path.open("x", encoding="utf-8") as file:
        try:
            file.write(text)
            file.flush()
        except OSError:
            path.unlink()  # a part of a file would be in the way of the next try
            raise


def print_json(document: Any) -> None:
    """One JSON document on stdout.  Times must be aware; NaN and infinities become null."""
    text = msgspec.json.format(msgspec.json.encode(document), indent=2)
    sys.stdout.write(text.decode() + "\n")


def print_json_list(head: Mapping[str, Any], key: str, batches: Iterable[list[Any]]) -> None:
    """The document ``head | {key: all batches together}`` as ``print_json`` prints it, a batch in memory at a time."""
    before, after = msgspec.json.format(msgspec.json.encode(dict(head) | {key: []}), indent=2).decode().rsplit("[]", 1)
    sys.stdout.write(before + "[")
    comma = ""
    for batch in filter(None, batches):
        text = msgspec.json.format(msgspec.json.encode(batch), indent=2).decode()
        sys.stdout.write(comma + text[1:-2].replace("\n", "\n  "))
        comma = ","
    sys.stdout.write(f"\n  ]{after}\n" if comma else f"]{after}\n")


def print_lines(lines: Sequence[str]) -> None:
    """Plain lines on stdout."""
    sys.stdout.write("".join(f"{printable(line)}\n" for line in lines))


def print_plot(text: str) -> None:
    """A plot on stdout, which may have colours."""
    sys.stdout.write(f"{text}\n")


def print_markup(*lines: str) -> None:
    """Lines of rich markup; plain where stdout is no terminal or NO_COLOR is set."""
    _print(*map(printable, lines))


def print_table(
    columns: Sequence[str], rows: Sequence[Row], right: Sequence[str] = (), spare: Sequence[str] = ()
) -> None:
    """A table in the one style of all commands; ``right`` names the columns of numbers, ``spare`` those that a narrow
    terminal does without.  Cells may hold rich markup.  A terminal wraps long cells between words; where that is not
    enough, each row is some lines of a name and a value.  In a file or a pipe a row is one line."""
    if len(rows) > MOST_IN_COLOUR or not sys.stdout.isatty():
        _print_plain(columns, [rows], right)
        return
    rows = [[_cell(cell) for cell in row] for row in rows]
    from rich.box import SIMPLE_HEAD
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    plain = [[Text.from_markup(cell).plain for cell in row] for row in rows]
    available = Console().width
    fit = column_widths(columns, plain, available)
    if fit is None and spare:
        kept = [index for index, name in enumerate(columns) if name not in spare]
        print_table([columns[i] for i in kept], [[row[i] for i in kept] for row in rows], right)
        return
    if fit is None:
        print_lines(records(columns, plain, available))
        return
    widths, gap = fit
    table = Table(box=SIMPLE_HEAD, pad_edge=False, show_edge=False, padding=(0, gap // 2))
    for name, width in zip(columns, widths, strict=True):
        table.add_column(name, justify="right" if name in right else "left", overflow="fold", width=width)
    for row in rows:
        table.add_row(*row)
    _print(table)


def print_long_table(
    columns: Sequence[str], batches: Iterator[Sequence[Row]], right: Sequence[str] = (), spare: Sequence[str] = ()
) -> bool:
    """The same of rows that come in batches, of which two are in memory at a time; False when there are none."""
    first, second = next(batches, ()), next(batches, ())
    if second:
        _print_plain(columns, chain([first, second], batches), right)
    elif first:
        print_table(columns, first, right, spare)
    return bool(first)


def _print_plain(columns: Sequence[str], batches: Iterable[Sequence[Row]], right: Sequence[str]) -> None:
    """The same table without colours: rich takes a millisecond a row.  A column is as wide as its cells so far."""
    from rich.cells import cell_len
    from rich.markup import render

    widths, head = [0] * len(columns), [columns]
    for rows in batches:
        cells = [*head, *([_cell(render(cell).plain if "[" in cell else cell) for cell in row] for row in rows)]
        columns_of_cells = zip(widths, *cells, strict=True)
        widths = [max(width, *map(cell_len, column)) for width, *column in columns_of_cells]
        lines = [_aligned(row, columns, right, widths) for row in cells]
        lines[len(head) : len(head)] = ["─" * (sum(widths) + 3 * (len(widths) - 1))] * len(head)
        print_lines(lines)
        head = []


def _aligned(row: Row, columns: Sequence[str], right: Sequence[str], widths: Sequence[int]) -> str:
    from rich.cells import cell_len

    cells = []
    for name, cell, width in zip(columns, row, widths, strict=True):
        gap = " " * (width - cell_len(cell))
        cells.append(gap + cell if name in right else cell + gap)
    return "   ".join(cells).rstrip()


def _cell(text: str) -> str:
    return text if text.isprintable() else printable(" ".join(text.splitlines()))


def _print(*items: object) -> None:
    from rich.console import Console

    Console(highlight=False).print(*items, sep="\n", soft_wrap=True)


def counted(count: int, noun: str) -> str:
    """``1 window``, ``2 windows``."""
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"


def number(value: float) -> str:
    """A score with two decimals, "-" where there is none; one of a million and more with three digits."""
    return "-" if math.isnan(value) else f"{value:.2f}" if abs(value) < 1e6 else f"{value:.3g}"


def arcmin(angle: float) -> str:
    """An angle [rad] in arc-minutes, a dash where it is unknown."""
    return "-" if math.isnan(angle) else f"{angle * ARC_MINUTES:.1f}'"


def bar(value: float, full: float, width: int = 12) -> str:
    """A bar of eighths of a character, as long as ``value`` is of ``full``."""
    if not value > 0 or not full > 0:
        return ""
    eighths = round(min(value / full, 1.0) * width * 8)
    return "█" * (eighths // 8) + "▏▎▍▌▋▊▉"[eighths % 8 - 1] * (eighths % 8 > 0)
