"""``lostmotion lab compare``: arguments, table and plot only."""

from __future__ import annotations

from pathlib import Path

import click

from lostmotion.lab.commands.options import curves_option, json_option, model_argument, report_option
from lostmotion.lab.commands.reading import Files, recordings_argument

__all__ = ["compare"]


@click.command(short_help="The error of a model, and where it arises.")
@model_argument
@recordings_argument
@report_option
@curves_option
@json_option
def compare(model: str, recordings: Files, report: Path | None, curves: Path | None, as_json: bool) -> None:
    """Compare MODEL with recordings: its error, where it fails, and in which equation.

    MODEL is a model file, or the name of a base.  No parameter is fitted; the initial state of each recording is
    estimated.
    """
    from lostmotion.lab.commands.output import write_output
    from lostmotion.lab.comparison.compare import compare as compared
    from lostmotion.lab.data.experiment import experiments
    from lostmotion.lab.errors import ExperimentError
    from lostmotion.lab.models import modelfile
    from lostmotion.model import ModelError

    built = modelfile.load(model).build()
    read = recordings.read()
    try:
        found = compared(built, experiments(built, read), recordings=read)
    except ModelError as error:
        raise ExperimentError(f"{model}: the model cannot be run on these recordings: {error}") from error
    if write_output(found, "comparison", report, curves, as_json=as_json):
        return
    from lostmotion.lab.commands.compare_terminal import show

    show(found)
