"""``lostmotion lab compare``: arguments, table and plot only."""

from __future__ import annotations

import json
from pathlib import Path

import click

__all__ = ["compare"]


@click.command(short_help="How far a model is off, and where.")
@click.argument("model")
@click.argument("recordings", nargs=-1, required=True, type=click.Path(path_type=Path), metavar="REC...")
@click.option(
    "--report", type=click.Path(path_type=Path), metavar="F.html", help="Write a report to open in a browser."
)
@click.option("--json", "as_json", is_flag=True, help="One JSON document on stdout, nothing else there.")
def compare(model: str, recordings: tuple[Path, ...], report: Path | None, as_json: bool) -> None:
    """Hold MODEL against recordings: how far it is off, where it fails, and in which equation.

    MODEL is a model file, or the name of a base.  No parameter is fitted; the state in which each recording begins is
    searched for.
    """
    from lostmotion.drivers.recording import read_recording
    from lostmotion.lab import modelfile
    from lostmotion.lab.compare import compare as compared
    from lostmotion.lab.errors import ExperimentError
    from lostmotion.lab.experiment import experiments
    from lostmotion.model import ModelError

    built = modelfile.load(model).build()
    read = [read_recording(path) for path in recordings]
    try:
        found = compared(built, experiments(built, read), recordings=read)
    except ModelError as error:
        raise ExperimentError(f"{model}: the model cannot be run on these recordings: {error}") from error
    if report is not None:
        from lostmotion.lab.report import write_report

        write_report(report, comparison=found)
    if as_json:
        click.echo(json.dumps(found.document(), ensure_ascii=False, allow_nan=False))
        return
    from lostmotion.lab.commands.compare_terminal import show

    show(found)
