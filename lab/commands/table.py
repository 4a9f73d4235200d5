"""The table of the lab's commands in a terminal, a file or a pipe."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Sequence

import click

from lostmotion.drivers.terminal import column_widths, records

__all__ = ["print_table"]

WIDE = 1000
"""Columns of a line that does not go to a terminal: a row is one line there."""


def print_table(columns: Sequence[str], rows: Iterable[Sequence[str]], right: Sequence[str] = ()) -> None:
    """Prints rows below the names of their columns; ``right`` names those of numbers.  A terminal wraps long cells
    between words; where that is not enough, each row is some lines of a name and a value."""
    from rich.box import SIMPLE_HEAD  # imported late, with the two below: help and errors do without
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    console, rows = Console(width=None if sys.stdout.isatty() else WIDE), list(rows)
    fit = column_widths(columns, rows, console.width)
    if fit is None:
        click.echo("\n".join(records(columns, rows, console.width)))
        return
    widths, gap = fit
    table = Table(box=SIMPLE_HEAD, pad_edge=False, show_edge=False, padding=(0, gap // 2))
    for name, width in zip(columns, widths, strict=True):
        justify = "right" if name in right else "left"
        table.add_column(Text(name), justify=justify, overflow="fold", width=width)  # type: ignore[arg-type]
    for row in rows:
        table.add_row(*map(Text, row))
    with console.capture() as capture:
        console.print(table)
    click.echo("\n".join(map(str.rstrip, capture.get().splitlines())))
