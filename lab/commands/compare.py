"""``lostmotion lab compare``: arguments, table and plot only."""

from __future__ import annotations

from pathlib import Path

import click

from lostmotion.lab.commands.options import curves_option, json_option, model_argument, report_option
from lostmotion.lab.commands.reading import Files, recordings_argument, used

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

    with used(model, recordings) as (built, experiments, read):
        found = compared(built, experiments, recordings=read)
    if write_output(found, "comparison", report, curves, as_json=as_json):
        return
    from lostmotion.lab.commands.compare_terminal import show

    show(found)
