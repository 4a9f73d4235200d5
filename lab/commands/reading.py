"""The recordings argument of the lab's commands: arguments and files only."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from lostmotion.drivers.recording import Recording

__all__ = ["Files", "recordings_argument"]


@dataclass(frozen=True)
class Files:
    """Recording files.  joint, terms: defaults for those without an address of their own (``FILE#joint=NAME``)."""

    paths: tuple[Path, ...]
    joint: str = ""
    terms: tuple[str, ...] = ()

    def read(self) -> list[Recording]:
        """Reads all of them.  Raises RecordingError."""
        from lostmotion.drivers.recording import read_recording

        return [read_recording(path, self.joint, self.terms) for path in self.paths]


def recordings_argument(command: Callable[..., None]) -> Callable[..., None]:
    """The argument REC... with ``--joint`` and ``--map``, which the command gets as ``recordings``, of type Files."""

    @click.argument("paths", nargs=-1, required=True, type=click.Path(path_type=Path), metavar="REC...")
    @click.option("--joint", default="", metavar="NAME", help="Which joint, where a recording has several.")
    @click.option("--map", "terms", multiple=True, metavar="COLUMN=SERIES[:UNIT]",
                  help="What a column is: position=angle:deg, torque=iq*1.21, torque= for none.")  # fmt: skip
    @wraps(command)
    def with_files(*args: Any, paths: tuple[Path, ...], joint: str, terms: tuple[str, ...], **given: Any) -> None:
        command(*args, recordings=Files(paths, joint, terms), **given)

    return with_files
