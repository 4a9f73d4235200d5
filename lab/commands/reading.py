"""Reads the model and the recordings of the lab's commands."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from lostmotion.lab.commands.options import FILE

if TYPE_CHECKING:
    from lostmotion.drivers.recording import Recording
    from lostmotion.lab.data.experiment import Experiment
    from lostmotion.model import Model

__all__ = ["Files", "recordings_argument", "used"]

MODELS = (
    "joint (what a torque, a current or a voltage drives, or what swings freely), servo (what follows a goal), "
    "oscillator (a mass on a spring, a bar that rings) and play (gears)"
)
"""what each base is, for one who does not know them"""


@dataclass(frozen=True)
class Files:
    """Recording files.  joint, terms: defaults for those without an address of their own (``FILE#joint=NAME``)."""

    paths: tuple[Path, ...]
    joint: str = ""
    terms: tuple[str, ...] = ()

    def read(self, base: str = "") -> list[Recording]:
        """The recordings, for this base.  Raises RecordingError."""
        from lostmotion.drivers.pipes import from_input
        from lostmotion.drivers.recordings import read_recordings

        paths = [from_input(path) for path in self.paths]
        return read_recordings(paths, self.joint, self.terms, base=base)


def _recordings(ctx: click.Context, param: click.Parameter, paths: tuple[Path, ...]) -> tuple[Path, ...]:
    """These; without any what is missing: the model, where a recording stands in its place."""
    if paths or ctx.resilient_parsing:
        return paths
    first = str(ctx.params.get("model", ""))
    if Path(first.partition("#")[0]).exists() and Path(first).suffix.lower() != ".toml":
        raise click.UsageError(
            f"found no model before {first}, expected a base or a model file first, as in {ctx.command_path} joint "
            f"{first}; the bases are {MODELS}"
        )
    raise click.MissingParameter(ctx=ctx, param=param)


def recordings_argument(command: Callable[..., None]) -> Callable[..., None]:
    """The argument REC... with ``--joint`` and ``--map``, which the command gets as ``recordings``, of type Files."""

    @click.argument("paths", nargs=-1, type=FILE, metavar="REC...",
                    callback=_recordings)  # fmt: skip
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
    from lostmotion.lab.data.stated_bar import bar_of
    from lostmotion.lab.errors import ExperimentError
    from lostmotion.lab.models import modelfile
    from lostmotion.model import ModelError

    file = modelfile.load(model)
    try:
        bare = file.build()
        read = recordings.read(bare.base)
        built = file.build(bar_of(bare, read))
        with _merged_warnings():
            for recording in read:
                warn_of_units(recording)
            prepared = experiments(built, read)
        yield built, prepared, read
    except ModelError as error:
        raise ExperimentError(f"{model}: the model cannot be run on these recordings: {error}") from error


class _Kept(logging.Handler):
    """Keeps the records that are alike but for the recording's name, the first argument, together."""

    def __init__(self) -> None:
        super().__init__()
        self.groups: dict[object, list[logging.LogRecord]] = {}

    def emit(self, record: logging.LogRecord) -> None:
        args = record.args if isinstance(record.args, tuple) else ()
        is_named = record.msg.startswith("%s: ") and len(args) > 0
        self.groups.setdefault((record.msg, args[1:]) if is_named else id(record), []).append(record)


@contextmanager
def _merged_warnings() -> Iterator[None]:
    """Logs what is said of several recordings once, at the end, with the first one's name and the number of others."""
    logger, kept = logging.getLogger("lostmotion.lab"), _Kept()
    logger.addHandler(kept)
    logger.propagate = False
    try:
        yield
    finally:
        logger.propagate = True
        logger.removeHandler(kept)
        for first, *others in kept.groups.values():
            if others and isinstance(first.args, tuple):
                first.args = (f"{first.args[0]} and {len(others)} more", *first.args[1:])
            logging.getLogger(first.name).handle(first)
