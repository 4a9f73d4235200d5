"""The options that commands share."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import click

from lostmotion.daemon.commands.completion import joints
from lostmotion.drivers.units import to_si

__all__ = [
    "FILE",
    "READABLE",
    "as_json",
    "column",
    "combined",
    "config_file",
    "damping",
    "database",
    "duration",
    "joint",
    "moment",
    "positive",
    "resonance",
    "since",
    "statistic",
    "trend_level",
    "trend_of",
    "until",
]


Command = Callable[..., Any]


def combined(*options: Callable[[Command], Command]) -> Callable[[Command], Command]:
    """Arguments and options as one decorator, in this order."""

    def decorate(command: Command) -> Command:
        for option in reversed(options):
            command = option(command)
        return command

    return decorate


def positive(ctx: click.Context, param: click.Parameter, value: float | None) -> float | None:
    """Refuses what is not a finite number above 0."""
    if value is not None and not (value > 0 and math.isfinite(value)):
        raise click.BadParameter(f"found {value}, expected a number above 0", ctx, param)
    return value


def moment(ctx: click.Context, param: click.Parameter, value: str | None) -> datetime | None:
    """ISO 8601, or how long ago."""
    from lostmotion.daemon.times import TimeError, parse

    try:
        return None if value is None else parse(value, datetime.now(UTC))
    except TimeError as error:
        raise click.BadParameter(str(error), ctx, param) from error


class _Limit(click.ParamType):  # type: ignore[type-arg]  # generic from click 8.4 on only
    """A limit of a score, or of an angle in rad, or with its unit: ``60'``, ``1deg``."""

    name = "limit"

    def convert(self, value: object, param: click.Parameter | None, ctx: click.Context | None) -> float:
        found = re.fullmatch(r"\s*([0-9.eE+-]+)\s*(\D*?)\s*", str(value))
        try:
            number = float(found[1]) if found else math.nan
        except ValueError:
            number = math.nan
        si, factor = to_si({"": "rad", "'": "arcmin"}.get(found[2], found[2]) if found else "") or ("", 0.0)
        if si != "rad" or not (number > 0 and math.isfinite(number)):
            self.fail(f"found {value!r}, expected a number above 0, in rad or as 60' or 1deg", param, ctx)
        return number * factor


FILE = click.Path(path_type=Path, readable=False)
"""not tried here: who reads the file says why it cannot be read"""


class _Readable(click.Path):
    """A file to read; ``-`` is standard input."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Path:
        from lostmotion.drivers.pipes import from_input

        return from_input(Path(value))


READABLE = _Readable(path_type=Path)


as_json = click.option("--json", "as_json", is_flag=True, help="One JSON document on stdout, nothing else there.")
config_file = click.option("--config", type=FILE, metavar="FILE", help="Configuration (TOML).")
database = click.option(
    "--database", type=FILE, metavar="FILE", help="Database to read, instead of the configured one."
)
since = click.option("--since", callback=moment, metavar="TIME", help="From here on: 30d, 12h, 2w, or ISO 8601.")
until = click.option("--until", callback=moment, metavar="TIME", help="Up to here: as --since.")
joint = click.argument("joint", shell_complete=joints)
duration = click.option("--duration", type=float, callback=positive, metavar="S", help="Stop after so many seconds.")

column = click.option(
    "--column", default="accel", help="The column of the ring-down: accel (default), force, displacement …"
)
resonance = click.option(
    "--f-res-hz", type=float, callback=positive, metavar="X", help="Resonance of the oscillator [Hz]."
)
damping = click.option(
    "--zeta", type=float, callback=positive, metavar="X", help="Damping ratio of the oscillator [-]."
)

trend_of = click.option(
    "--of",
    type=click.Choice(["severity", "score", "play"]),
    help="Equivalent play (the default where there is one), scores, or the size of the play.",
)
trend_level = click.option(
    "--level",
    type=_Limit(),
    metavar="X",
    help="The limit, instead of alarm.severity_error, the newest score's level, or alarm.play_error: a score, or an "
    "angle in rad, or as 60' or 1deg.",
)
statistic = click.option(
    "--statistic",
    type=click.Choice(("band", "ringdown")),
    help="band (eq. 8), or ringdown, which uses the whole ring-down.",
)
