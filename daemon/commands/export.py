"""``lostmotion export``: arguments and text only.  The formats are drivers/formats'."""

from __future__ import annotations

from pathlib import Path

import click

from lostmotion.daemon.commands.options import FILE, READABLE, as_json
from lostmotion.drivers.errors import LostmotionError

__all__ = ["ExportError", "export"]


class ExportError(LostmotionError):
    """The target is of no known format."""


@click.command(short_help="Convert a recording for Foxglove, PlotJuggler, ROS 2 or Rerun.")
@click.argument("recording", type=READABLE, metavar="REC")
@click.option("-o", "--output", type=FILE, required=True, metavar="FILE",
              help="File to write: .mcap, or .rrd for Rerun; - is MCAP on stdout.")  # fmt: skip
@click.option("--joint", metavar="NAME", help="Name of the joint there.  [default: that in REC, else joint]")
@as_json
def export(recording: Path, output: Path, joint: str | None, as_json: bool) -> None:
    """Write REC for other programs: MCAP with messages of ROS 2 (Foxglove, PlotJuggler, ros2 bag), or Rerun.

    REC - is stdin.  An existing FILE is replaced, once all is written.
    """
    from lostmotion.daemon.commands.output import print_json
    from lostmotion.drivers.pipes import STANDARD, refuse_two_documents
    from lostmotion.drivers.recording import read_recording, replaced

    refuse_two_documents(output, as_json)
    suffix = ".mcap" if output == STANDARD else output.suffix.lower()
    if suffix not in (".mcap", ".rrd"):
        raise ExportError(f"{output}: found the ending {suffix!r}, expected .mcap, or .rrd for Rerun")
    read = read_recording(recording)
    name = joint or str(read.metadata.get("joint", "joint"))
    with replaced(output) as part:
        if suffix == ".mcap":
            from lostmotion.drivers.formats.to_mcap import write_mcap as write
        else:
            from lostmotion.drivers.formats.to_rerun import write_rerun as write
        count = write(read, name, part)
    if as_json:
        print_json({"file": str(output), "joint": name, "columns": list(read.columns), "count": count})
    else:
        what = "messages" if suffix == ".mcap" else "numbers"
        click.echo(f"{output}: {count} {what} of {', '.join(read.columns)}, joint {name}", err=True)
