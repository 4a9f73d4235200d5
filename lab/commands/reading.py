"""Reads the model and the recordings of the lab's commands."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from lostmotion.drivers.recording import Recording
    from lostmotion.lab.data.experiment import Experiment
    from lostmotion.model import Model

__all__ = ["Files", "recordings_argument", "used"]


@dataclass(frozen=True)
class Files:
    """Recording files.  joint, terms: defaults for those without an address of their own (``FILE#joint=NAME``)."""

    paths: tuple[Path, ...]
    joint: str = ""
    terms: tuple[str, ...] = ()

    def read(self) -> list[Recording]:
        """Raises RecordingError."""
        from lostmotion.drivers.recording import read_recordings

        return read_recordings(self.paths, self.joint, self.terms)


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


@contextmanager
def used(model: str, recordings: Files) -> Iterator[tuple[Model, tuple[Experiment, ...], list[Recording]]]:
    """Yields the model, the experiments prepared for it, and the recordings as they are.  Raises ExperimentError, also
    for a ModelError within the block, where model and recordings cannot be used together."""
    from lostmotion.lab.data.experiment import experiments
    from lostmotion.lab.data.readings import warn_of_units
    from lostmotion.lab.errors import ExperimentError
    from lostmotion.lab.models import modelfile
    from lostmotion.model import ModelError

    built, read = modelfile.load(model).build(), recordings.read()
    for recording in read:
        warn_of_units(recording)
    try:
        yield built, experiments(built, read), read
    except ModelError as error:
        raise ExperimentError(f"{model}: the model cannot be run on these recordings: {error}") from error
