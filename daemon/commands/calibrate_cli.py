"""The arguments of ``lostmotion calibrate``; the commands are in ``calibrate_*.py``."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from lostmotion.daemon.cli import FILE, as_json, config_file, positive, statistic
from lostmotion.daemon.commands.asked import Asked
from lostmotion.daemon.commands.calibrate_bar import calibrate_bar as bar
from lostmotion.daemon.commands.calibrate_bar import parse_quantity
from lostmotion.daemon.commands.calibrate_healthy import calibrate_healthy as healthy
from lostmotion.daemon.commands.calibrate_level import CRITERIA
from lostmotion.daemon.commands.calibrate_level import calibrate_level as level
from lostmotion.daemon.commands.calibrate_tap import calibrate_tap as tap
from lostmotion.daemon.commands.completion import joints
from lostmotion.detector.cantilever import MATERIALS

__all__ = ["calibrate"]


@click.group()
def calibrate() -> None:
    """Find the detector's settings from recordings, as lines for the configuration."""


def lengths(*names: str) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """An option for a length, as in 10mm."""
    return click.option(*names[:1], callback=quantity("m"), metavar="LENGTH", help=names[1])


def quantity(unit: str) -> Callable[[click.Context, click.Parameter, str | None], float | None]:
    """A callback that takes a number and its unit to SI."""

    def convert(ctx: click.Context, param: click.Parameter, value: str | None) -> float | None:
        try:
            return None if value is None else parse_quantity(value, unit)
        except ValueError as error:
            raise click.BadParameter(str(error), ctx, param) from error

    return convert


toml_out = click.option("-o", "--output", type=FILE, metavar="FILE", help="Write the lines to a new file as well.")
recordings = click.argument("recordings", type=FILE, nargs=-1, required=True, metavar="REC...")


@calibrate.command("bar", short_help="How long a bar must be for a frequency, before it is cut.")
@click.option("--material", type=click.Choice(tuple(MATERIALS)), default="steel", show_default=True, help="Of the bar.")
@lengths("--width", "Of a flat bar, as in 10mm.")
@lengths("--thickness", "Of a flat bar, across which it bends, as in 1mm.")
@lengths("--diameter", "Of a round rod, instead of width and thickness.")
@click.option("--tip", default="0g", callback=quantity("kg"), metavar="MASS", help="Sensor, screws and glue, as in 5g.")
@click.option("--frequency", type=float, callback=positive, metavar="HZ", help="The resonance that is wanted [Hz].")
@lengths("--length", "Of a bar that is there: which resonance has it?")
@toml_out
@as_json
def calibrate_bar(
    material: str,
    tip: float,
    frequency: float | None,
    length: float | None,
    output: Path | None,
    as_json: bool,
    **section: float | None,
) -> None:
    """The length of a bar, clamped at one end with the sensor at the other, for a resonance; or its resonance."""
    bar(material, section, tip, frequency, length, output, as_json)


@calibrate.command("tap", short_help="Resonance and damping of the bar, from taps.")
@recordings
@click.option("--column", default="accel", help="The column of the ring-down: accel (default), force, displacement …")
@toml_out
@as_json
def calibrate_tap(recordings: tuple[Path, ...], column: str, output: Path | None, as_json: bool) -> None:
    """The oscillator's resonance and damping from recordings of taps on the bar, some seconds apart."""
    tap(recordings, column, output, as_json)


worn_recordings = click.option(
    "--worn", type=FILE, multiple=True, metavar="REC", help="Of a joint with play; again for more."
)


def about_settings(command: Callable[..., None]) -> Callable[..., None]:
    """The options that choose the settings."""
    options = (
        config_file,
        click.option("--joint", metavar="NAME", help="The joint whose settings count.", shell_complete=joints),
        click.option(
            "--f-res-hz", type=float, callback=positive, metavar="X", help="Resonance of the oscillator [Hz]."
        ),
        click.option("--zeta", type=float, callback=positive, metavar="X", help="Damping ratio of the oscillator [-]."),
    )
    for option in reversed(options):
        command = option(command)
    return command


@calibrate.command("healthy", short_help="Window, bands and noise, from a healthy joint.")
@recordings
@worn_recordings
@about_settings
@toml_out
@as_json
def calibrate_healthy(
    recordings: tuple[Path, ...],
    worn: tuple[Path, ...],
    config: Path | None,
    output: Path | None,
    as_json: bool,
    **given: Any,
) -> None:
    """Window, bands and noise from recordings of a healthy joint in motion; and the acceleration that is needed.

    Without --worn, simulated rings of the bar are added to the healthy windows.
    """
    healthy(recordings, worn, config, Asked(**given), output, as_json)


@calibrate.command("level", short_help="The level, from healthy and worn joints.")
@recordings
@worn_recordings
@about_settings
@statistic
@click.option(
    "--false-alarm",
    type=click.FloatRange(0, 0.5, min_open=True),
    default=0.01,
    show_default=True,
    metavar="P",
    help="Promised share of healthy windows above the level; without --worn.",
)
@click.option(
    "--criterion",
    type=click.Choice(tuple(CRITERIA)),
    default="eq9",
    show_default=True,
    help="What is best, with --worn: eq. 9, or Youden's J.",
)
@toml_out
@as_json
def calibrate_level(
    recordings: tuple[Path, ...],
    worn: tuple[Path, ...],
    config: Path | None,
    false_alarm: float,
    criterion: str,
    output: Path | None,
    as_json: bool,
    **given: Any,
) -> None:
    """The level: eq. 9 where there are worn recordings, else the one that keeps a promised rate of false alarms."""
    level(recordings, worn, config, Asked(**given), false_alarm, criterion, output, as_json)
