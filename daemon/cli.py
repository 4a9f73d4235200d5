"""The command line.  Its commands are implemented in ``commands``, imported when they are called, so that ``--help``
is quick and the running service carries no plots; groups have their arguments there, too.  The lab's come late as well.

A command returns its exit status (``commands/guard.py``); None means 0.
"""

from __future__ import annotations

import os
import sys
import warnings
from datetime import datetime
from pathlib import Path
from typing import Any, Literal

import click

from lostmotion import __version__
from lostmotion.daemon.commands.completion import accelerometers, joints
from lostmotion.daemon.commands.guard import LateCommand, RootGroup
from lostmotion.daemon.commands.options import (
    FILE,
    READABLE,
    as_json,
    column,
    config_file,
    damping,
    database,
    duration,
    joint,
    positive,
    resonance,
    since,
    statistic,
    trend_level,
    trend_of,
    until,
)
from lostmotion.drivers.pipes import refuse_two_documents

__all__ = ["cli", "main"]


@click.group(cls=RootGroup, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100})
@click.version_option(__version__, message="%(prog)s %(version)s")
def cli() -> None:
    """Detects play in a robot's joints: monitors servos, scores every reversal, and keeps the history of wear."""


def main() -> None:
    """The program ``lostmotion``."""
    # Our matrices are small: the threads of BLAS cost a service more than they gain, up to 30 ms where one takes 1.
    for library in ("OPENBLAS", "MKL"):
        os.environ.setdefault(f"{library}_NUM_THREADS", "1")
    if not sys.warnoptions:  # NumPy's, with lines of our source, on input that an error of ours describes
        warnings.simplefilter("ignore", RuntimeWarning)
    cli.main()


@cli.command()
@config_file
@duration
def run(config: Path | None, duration: float | None) -> int:
    """Monitor the robot, in the foreground (the service).

    Without --config a simulated robot runs, and its database is in the user's state folder.
    """
    from lostmotion.daemon import config as configuration
    from lostmotion.daemon import heap, service

    heap.set_up()
    if config is None:
        return service.run(configuration.default(), duration_s=duration)
    return service.run(configuration.load(config), duration_s=duration, reload=lambda: configuration.load(config))


@cli.command(short_help="Check the devices, or find what is plugged in.")
@config_file
@click.option("--find", is_flag=True, help="Look for servos, sensors and buses instead; needs no configuration.")
@click.option("--port", multiple=True, metavar="PORT", help="With --find: only this serial port; again for more.")
@click.option("-o", "--output", type=FILE, metavar="FILE", help="With --find: write a configuration to start from.")
@as_json
def doctor(config: Path | None, find: bool, port: tuple[str, ...], output: Path | None, as_json: bool) -> int:
    """Check devices, rates, noise, clock, disk: value and allowed range of each.  Exit status 1 if one is bad.

    Without --config: the installed service's, else the simulated robot.  The devices must be free: stop the service
    first.

    With --find: listens to every free serial port, asks silent ones which servos are there (pings and reads,
    nothing is written to them), and lists CAN interfaces and the kernel's accelerometers.  Exit status 1 if there is
    nothing.
    """
    if find:
        from lostmotion.daemon.commands.find import find as look

        if config is not None:
            raise click.UsageError("found --config and --find, expected one of them; --find needs no configuration")
        return look(port, output, as_json)
    if port or output is not None:
        raise click.UsageError("found --port or --output without --find, expected them with it only")
    from lostmotion.daemon.commands.doctor import doctor

    return doctor(config, as_json)


@cli.command()
@config_file
@database
@click.option("--fail", is_flag=True, help="Exit status 1 while an alarm is active.")
@as_json
def status(config: Path | None, database: Path | None, fail: bool, as_json: bool) -> int:
    """Joints, their health, and active alarms."""
    from lostmotion.daemon.commands.status import status

    return status(config, database, fail, as_json)


@cli.command()
@joint
@config_file
@database
@since
@until
@click.option("--limit", type=click.IntRange(1, 10**9), metavar="N", help="The newest N of them.")
@click.option("--csv", "as_csv", is_flag=True, help="CSV on stdout.")
@click.option(
    "--parquet",
    type=FILE,
    metavar="FILE",
    help="Write an Apache Parquet file (needs lostmotion[parquet]); - is stdout.",
)
@as_json
def history(
    joint: str,
    config: Path | None,
    database: Path | None,
    since: datetime | None,
    until: datetime | None,
    limit: int | None,
    as_csv: bool,
    parquet: Path | None,
    as_json: bool,
) -> None:
    """Scores of a joint, oldest first."""
    from lostmotion.daemon.commands.history import history

    forms = [form for form, asked in (("csv", as_csv), ("json", as_json), (parquet, parquet)) if form and asked]
    if len(forms) > 1:
        raise click.UsageError("found more than one of --csv, --json and --parquet, expected one of them")
    history(joint, config, database, (since, until, limit), forms[0] if forms else "table")


@cli.command(short_help="Wear of a joint: slope, changes, time until the limit.")
@joint
@config_file
@database
@since
@until
@trend_of
@trend_level
@click.option("--png", type=FILE, metavar="FILE", help="Draw the plot into a picture (png, svg, pdf).")
@as_json
def trend(
    joint: str,
    config: Path | None,
    database: Path | None,
    since: datetime | None,
    until: datetime | None,
    of: Literal["severity", "score", "play"] | None,
    level: float | None,
    png: Path | None,
    as_json: bool,
) -> None:
    """Wear of a joint: slope, significance, changes, and the time until the limit."""
    from lostmotion.daemon.commands.trend import trend

    trend(joint, config, database, (since, until), of, level, png, as_json)


@cli.command()
@click.option("--config", type=FILE, metavar="FILE", required=True, help="Configuration (TOML).")
@click.option("--duration", type=float, callback=positive, metavar="S", required=True, help="Seconds to record.")
@click.option("-o", "--output", type=FILE, metavar="REC", required=True, help="Recording to write (CSV); - is stdout.")
@click.option("--joint", metavar="NAME", help="Which joint; required when there are several.", shell_complete=joints)
@click.option(
    "--accelerometer", metavar="NAME", help="This one alone, as for calibrate tap.", shell_complete=accelerometers
)
@as_json
def record(
    config: Path, duration: float, output: Path, joint: str | None, accelerometer: str | None, as_json: bool
) -> None:
    """Record a joint, or an accelerometer alone.  Ctrl-C ends it early and keeps the recording.

    An existing REC is replaced, once something is measured.
    """
    from lostmotion.daemon.commands.record import record

    if joint is not None and accelerometer is not None:
        raise click.UsageError("found --joint and --accelerometer, expected one of them")
    refuse_two_documents(output, as_json)
    record(config, duration, output, joint, accelerometer, as_json)


@cli.command()
@click.argument("recording", type=READABLE)
@config_file
@click.option("--joint", metavar="NAME", help="Its settings count; its name is shown.", shell_complete=joints)
@column
@resonance
@damping
@click.option("--level", type=float, callback=positive, metavar="X", help="Level of eq. 9 [-].")
@statistic
@as_json
def score(recording: Path, config: Path | None, joint: str | None, as_json: bool, **given: Any) -> None:
    """Score a recording, window by window; - is stdin.

    Settings: the options here, else --config, else the recording's head, else the defaults.
    """
    from lostmotion.daemon.commands.score import score
    from lostmotion.daemon.commands.scoring_options import ScoringOptions

    score(recording, config, ScoringOptions(joint=joint, **given), as_json)


LATE = (
    ("config", "daemon.commands.config_check:config_group", "Check a configuration."),
    ("alarms", "daemon.commands.alarms:alarms", "Alarms: list, watch, ack, shelve."),
    ("service", "daemon.commands.service:service", "The systemd service: install, uninstall."),
    ("fleet", "daemon.commands.fleet:fleet", "Query all robots on a network."),
    ("calibrate", "daemon.commands.calibrate:calibrate", "Find the detector's settings from recordings."),
    ("import", "daemon.commands.import_recording:import_recording", "Convert another program's file to a recording."),
    ("export", "daemon.commands.export:export", "Convert a recording for Foxglove, PlotJuggler, ROS 2 or Rerun."),
    ("web", "web.cli:web", "Serve the page: health, alarms, history and windows, in a browser."),
    ("simulate", "lab.cli:simulate", "Make a recording from a model."),
    ("effects", "lab.cli:effects", "The catalogue of effects, with their equations."),
    ("lab", "lab.commands:lab", "Compare a model with measurements."),
)
"""name, module and attribute, and help of the commands that are imported when they are called"""
for name, target, short_help in LATE:
    cli.add_command(LateCommand(name, f"lostmotion.{target}", short_help))
