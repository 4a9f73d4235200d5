"""What a terminal may be sent: texts of others without control characters, colours where it has them, and a sign of
life while a command computes."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager

__all__ = ["has_colours", "printable", "waiting"]


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


def has_colours() -> bool:
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
