"""What a terminal may be sent: texts of others without control characters, and colours where it has them."""

from __future__ import annotations

__all__ = ["has_colours", "printable"]


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
