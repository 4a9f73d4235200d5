"""The arguments of ``lostmotion alarms``; the commands are in ``alarms.py``."""

from __future__ import annotations

import getpass
import os
from pathlib import Path

import click

from lostmotion.daemon import times
from lostmotion.daemon.cli import as_json, config_file, database, positive
from lostmotion.daemon.commands.alarms import change, show, watch
from lostmotion.daemon.commands.completion import joints
from lostmotion.daemon.records import Cause, Request, Verb

__all__ = ["alarms"]


LONGEST_S = 366 * 86400.0
"""what should be silent for longer should leave the configuration [s]"""


def seconds(ctx: click.Context, param: click.Parameter, value: str) -> float:
    """A length of time, a year at most."""
    try:
        length = positive(ctx, param, times.length(value)) or 0.0
    except times.TimeError as error:
        raise click.BadParameter(str(error), ctx, param) from error
    if length > LONGEST_S:
        raise click.BadParameter(f"found {value}, expected a year at most", ctx, param)
    return length


class DefaultList(click.Group):
    """A group that lists when no subcommand is named."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        named = args and (not args[0].startswith("-") or args[0] in ctx.help_option_names)
        return super().parse_args(ctx, args if named else ["list", *args])


@click.group(cls=DefaultList)
def alarms() -> None:
    """Alarms: list them, watch them, acknowledge or shelve them.  Without a subcommand: list."""


cause = click.option("--cause", type=click.Choice(["play", "device"]), help="Only this alarm of the joint.")


@alarms.command("list", short_help="Alarms that are active or not acknowledged.")
@config_file
@database
@click.option("--all", "everything", is_flag=True, help="Also those that are over.")
@as_json
def alarms_list(config: Path | None, database: Path | None, everything: bool, as_json: bool) -> None:
    """Alarms that are active, acknowledged, shelved, or cleared but not acknowledged."""
    show(config, database, everything, as_json)


@alarms.command("watch")
@config_file
@database
@click.option("--duration", type=float, callback=positive, metavar="S", help="Stop after so many seconds.")
@click.option("--json", "as_json", is_flag=True, help="One JSON document a line.")
def alarms_watch(config: Path | None, database: Path | None, duration: float | None, as_json: bool) -> None:
    """Print each transition of an alarm as it happens."""
    watch(config, database, duration, as_json)


@alarms.command("ack")
@click.argument("joint", shell_complete=joints)
@cause
@config_file
@database
@as_json
def alarms_ack(joint: str, cause: str | None, config: Path | None, database: Path | None, as_json: bool) -> int:
    """Acknowledge the joint's alarms.  Exit status 1 if there is none."""
    return _change(joint, Verb.ACK, cause, 0.0, config, database, as_json)


@alarms.command("shelve")
@click.argument("joint", shell_complete=joints)
@click.option(
    "--for", "length", default="8h", show_default=True, callback=seconds, metavar="TIME", help="30min, 8h, 2d."
)
@cause
@config_file
@database
@as_json
def alarms_shelve(
    joint: str, length: float, cause: str | None, config: Path | None, database: Path | None, as_json: bool
) -> int:
    """Suppress the joint's alarms for a time, such as during work.  Exit status 1 if there is none."""
    return _change(joint, Verb.SHELVE, cause, length, config, database, as_json)


@alarms.command("unshelve")
@click.argument("joint", shell_complete=joints)
@cause
@config_file
@database
@as_json
def alarms_unshelve(joint: str, cause: str | None, config: Path | None, database: Path | None, as_json: bool) -> int:
    """End shelving early.  Exit status 1 if nothing is shelved."""
    return _change(joint, Verb.UNSHELVE, cause, 0.0, config, database, as_json)


def _change(
    joint: str, verb: Verb, cause: str | None, for_s: float, config: Path | None, database: Path | None, as_json: bool
) -> int:
    request = Request(0, joint, verb, Cause(cause) if cause else None, for_s, os.environ.get("SUDO_USER") or _user())
    return change(config, database, request, as_json)


def _user() -> str:
    try:
        return getpass.getuser()
    except (KeyError, OSError):  # a container's user without a name
        return str(os.getuid())
