"""Small text files of people, read whole within a bound: configurations, models, effects; recordings: recording.py."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from lostmotion.drivers.errors import LostmotionError

__all__ = ["TextFileError", "near", "read_text", "shortened"]

MOST_CHARACTERS = 1_000_000
"""a configuration of 1000 joints takes a fifth of it"""
LONGEST_LINE = 1000
"""characters of an error about a file"""


class TextFileError(LostmotionError):
    """The file cannot be read, or is no such file; the one-line message has the cause."""


def read_text(path: Path) -> str:
    """The text, without the mark with which editors on Windows begin a file.  Raises TextFileError."""
    try:
        if path.is_fifo() and not path.is_relative_to("/dev"):  # a shell's <(…) is in /dev
            raise TextFileError(f"{path}: found a pipe, expected a file: reading a pipe may block forever")
        with path.open(encoding="utf-8-sig") as file:
            text = file.read(MOST_CHARACTERS + 1)
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is no UTF-8 text"
        raise TextFileError(f"{path}: cannot be read: {reason}") from error
    if len(text) > MOST_CHARACTERS:
        raise TextFileError(f"{path}: found more than {MOST_CHARACTERS} characters")
    return text


def shortened(message: object) -> str:
    """What is wrong with a file, without the middle of a key or name that is a page long."""
    text = str(message)
    return text if len(text) <= LONGEST_LINE else f"{text[: LONGEST_LINE // 2]} … {text[-LONGEST_LINE // 4 :]}"


def near(word: str, known: Iterable[str]) -> str:
    """What may be meant by an unknown word, whichever case it is in; else all that are known, in their order."""
    import difflib  # for a mistake only

    names = {name.casefold(): name for name in known}
    close = difflib.get_close_matches(word.casefold(), names, n=1, cutoff=0.6)
    return f"; did you mean {names[close[0]]}?" if close else f"; there are {', '.join(names.values())}"
