"""``lostmotion import``: arguments and text only.  The formats are drivers/formats'."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from lostmotion.daemon.commands.options import FILE, READABLE, as_json
from lostmotion.drivers.pipes import refuse_two_documents

if TYPE_CHECKING:
    from lostmotion.drivers.formats.read import Imported
    from lostmotion.drivers.formats.source import Choice, Series

__all__ = ["import_recording"]

SHOWN = 60
"""series that are listed"""


@click.command("import", short_help="Convert another program's file to a recording.")
@click.argument("file", type=READABLE)
@click.option("-o", "--output", type=FILE, metavar="REC", help="Recording to write (CSV); - is stdout.")
@click.option("--map", "terms", multiple=True, metavar="COLUMN=SERIES[:UNIT]",
              help="What a column is: position=angle:deg, torque=iq*1.21, torque= for none.")  # fmt: skip
@click.option("--joint", default="", metavar="NAME", help="Which joint, where the file has several.")
@click.option("--topic", "topics", multiple=True, metavar="T", help="MCAP, rosbag2: the topic that counts.")
@click.option("--episode", type=click.IntRange(0), metavar="N", help="Which episode, or run, from 0.")
@click.option("--rate-hz", type=float, metavar="R", help="Rows a second, where the file has no times.")
@as_json
def import_recording(
    file: Path, output: Path | None, terms: tuple[str, ...], joint: str, topics: tuple[str, ...],
    episode: int | None, rate_hz: float | None, as_json: bool,
) -> None:  # fmt: skip
    """Make a recording out of FILE: MCAP, a bag of ROS, a LeRobot dataset, PlotJuggler's or another CSV, a workbook,
    MAT, HDF5, NumPy, JSON, Parquet; - is stdin.

    Columns are assigned to series by names and units, and the assignment is printed on stderr; --map sets it.  Without
    -o nothing is written: the series of FILE and the assignment are listed.  Options may stand behind a # in FILE, too.
    """
    from lostmotion.drivers.formats.choice import parse_map, split_address
    from lostmotion.drivers.formats.source import Choice

    refuse_two_documents(output, as_json)
    file, own = split_address(file)
    choice = Choice(
        {**own.terms, **parse_map(terms)}, joint or own.joint, topics or own.topics,
        own.episode if episode is None else episode, own.rate_hz if rate_hz is None else rate_hz,
    )  # fmt: skip
    if output is None:
        _look(file, choice, as_json)
    else:
        _write(file, choice, output, as_json)


def _write(file: Path, choice: Choice, output: Path, as_json: bool) -> None:
    """Raises RecordingError."""
    from lostmotion.daemon.commands.output import counted, print_json
    from lostmotion.drivers.formats.read import imported
    from lostmotion.drivers.recording import write_recording

    found = imported(file, choice)
    click.echo("\n".join(found.lines()), err=True)
    write_recording(found.recording, output)
    if as_json:
        print_json({"recording": str(output), **_document(found)})
    else:
        rows, span = len(found.recording.time), found.recording.duration
        columns = ", ".join(found.recording.columns)
        click.echo(f"{output}: {counted(rows, 'row')} over {span:.6g} s of {columns}", err=True)


def _look(file: Path, choice: Choice, as_json: bool) -> None:
    """Lists what is there, and what would be taken; a choice that is not clear is printed, and is no error."""
    from lostmotion.daemon.commands.output import print_json, print_lines
    from lostmotion.drivers.errors import RecordingError
    from lostmotion.drivers.formats.read import imported
    from lostmotion.drivers.formats.registry import open_source

    source = open_source(file)
    found, problem = None, ""
    try:
        found = imported(file, choice)
    except RecordingError as error:
        problem = str(error)
    if as_json:
        series = [{"name": one.name, "unit": one.unit or None} for one in source.series]
        print_json({"format": source.kind, "series": series, **(_document(found) if found else {"problem": problem})})
        return
    print_lines([f"{file}: {source.kind}, {len(source.series)} series", *_names(source.series)])
    click.echo("\n".join(found.lines()) if found else problem, err=True)


def _names(series: Sequence[Series]) -> list[str]:
    from lostmotion.drivers.formats.source import shown

    names = [f"  {shown(one.name)}{f' [{one.unit}]' if one.unit else ''}" for one in series[:SHOWN]]
    return names + ([f"  … and {len(series) - SHOWN} more; --json lists all"] if len(series) > SHOWN else [])


def _document(found: Imported) -> dict[str, Any]:
    recording = found.recording
    return {
        "format": found.kind,
        "clock": found.clock,
        "joint": recording.metadata.get("joint"),
        "start": recording.metadata.get("start"),
        "rows": len(recording.time),
        "duration": recording.duration,
        "columns": [asdict(one) for one in found.columns],
        "notes": list(found.notes),
    }
