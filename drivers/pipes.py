"""Standard input and standard output where a command takes or writes a file: ``-``."""

from __future__ import annotations

import shutil
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

__all__ = ["STANDARD", "from_input", "refuse_two_documents", "to_output"]

STANDARD = Path("-")


def from_input(path: Path) -> Path:
    """The path; for ``-`` that of a temporary file with all of standard input, as a file is read more than once."""
    return Path(_input().name, "stdin") if path == STANDARD else path


@cache
def _input() -> TemporaryDirectory[str]:
    """A folder with what comes by standard input, which is removed at the end of the program."""
    folder = TemporaryDirectory(prefix="lostmotion-")
    with Path(folder.name, "stdin").open("wb") as file:
        shutil.copyfileobj(sys.stdin.buffer, file)
    return folder


@contextmanager
def to_output() -> Iterator[Path]:
    """The path of a file that goes to standard output when the block ends without an error."""
    with TemporaryDirectory(prefix="lostmotion-") as folder:
        path = Path(folder, "stdout")
        yield path
        with path.open("rb") as file:
            shutil.copyfileobj(file, sys.stdout.buffer)
        sys.stdout.buffer.flush()


def refuse_two_documents(output: Path | None, as_json: bool) -> None:
    """Raises UsageError where a file and a JSON document are both to go to standard output."""
    from click import UsageError

    if as_json and output == STANDARD:
        raise UsageError("found --json and -o -, expected one of them: both write to standard output")
