"""What a terminal may be sent: texts of others without control characters, colours where it has them, tables that fit,
and a sign of life while a command computes."""

from __future__ import annotations

import shutil
import sys
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

__all__ = ["blank_plot", "column_widths", "plot_text", "printable", "records", "waiting"]

NARROW = 120
"""Columns of a terminal below which a table that does not fit has narrower gaps."""
WIDEST = 120
"""Columns of a plot in a wide terminal."""
NARROWEST = 20
"""Columns of a plot in a terminal of fewer, which breaks its lines: the axis takes 6 of them, the ends 3."""
LONGEST_WORD = 16
"""What is longer, such as a formula or a path, may be broken, but not in the first column, which names the row."""


@contextmanager
def waiting(what: str) -> Iterator[None]:
    """Shows on standard error, where that is a terminal, what the block does and for how long it has done it."""
    if not sys.stderr.isatty():
        yield
        return
    from rich.console import Console
    from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    columns = (SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as progress:
        progress.add_task(what, total=None)
        yield


def blank_plot(title: str, height: int) -> tuple[Any, int]:
    """A plot by plotext (its ``figure``) of that many lines, coloured only where the terminal wants that, and its
    width."""
    import plotext

    width = min(max(shutil.get_terminal_size((100, height)).columns, NARROWEST), WIDEST)
    figure = plotext.figure
    figure.clear()
    figure.plot_size(width, height)
    figure.theme("simple" if _has_colours() else "colorless")
    figure.canvas("default")
    figure.title(title)
    return figure, width


def plot_text(figure: Any, width: int, legend: str) -> str:
    """A plot as text, with its legend in a line below, where it covers nothing."""
    text = str(figure.build().string(colorless=not _has_colours())).strip("\n")
    return f"{text}\n{legend:^{width}}".rstrip()


def _has_colours() -> bool:
    """Whether standard output is a terminal with colours, and NO_COLOR does not refuse them."""
    from rich.console import Console

    console = Console()
    return not (console.no_color or console.color_system is None)


def printable(text: str) -> str:
    """A text of others for a terminal, which obeys control characters: each but the end of a line is written as Python
    writes it, such as \\x1b; so are those that turn the direction of a line."""
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() or c == "\n" else c.encode("unicode_escape").decode() for c in text)


def column_widths(
    columns: Sequence[str], rows: Sequence[Sequence[str]], available: int
) -> tuple[list[int], int] | None:
    """Widths of the columns of a table, and of the gap between them: 3, or 1 on a terminal that is too narrow for that.
    The widest column that can be wrapped between words is narrowed first; None where a word would have to be broken."""
    from rich.cells import cell_len

    cells = list(zip(columns, *rows, strict=True))
    widths = [max(map(cell_len, column)) for column in cells]
    words = [max(cell_len(word) for cell in column for word in [*cell.split(), ""]) for column in cells]
    words[1:] = [min(word, LONGEST_WORD) for word in words[1:]]
    gap = 3 if available >= min(NARROW, sum(widths) + 3 * (len(columns) - 1)) else 1
    while sum(widths) + gap * (len(columns) - 1) > available:
        widest = max(range(len(columns)), key=lambda i: (widths[i] > words[i], widths[i]))
        if widths[widest] <= words[widest]:
            return None
        widths[widest] -= 1
    return widths, gap


def records(columns: Sequence[str], rows: Iterable[Sequence[str]], available: int) -> list[str]:
    """A table as lines of a name and a value, a row after the other, for terminals in which it does not fit; nothing
    for an empty cell."""
    from textwrap import wrap

    indent = max(map(len, columns)) + 2
    lines: list[str] = []
    for row in rows:
        lines += [""] * bool(lines)
        for name, value in zip(columns, row, strict=True):
            pieces = wrap(value, max(available - indent, 10), break_on_hyphens=False)
            names = [name, *[""] * (len(pieces) - 1)]
            lines += [f"{name:<{indent}}{piece}" for name, piece in zip(names, pieces, strict=False)]
    return lines
