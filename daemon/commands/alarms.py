"""``lostmotion alarms``: lists alarms, watches them, acknowledges and shelves them."""

from __future__ import annotations

import getpass
import math
import os
import sys
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import click
import msgspec

from lostmotion.daemon import documents, requests, times
from lostmotion.daemon.commands import output
from lostmotion.daemon.commands.options import as_json, combined, config_file, database, duration, joint, positive
from lostmotion.daemon.commands.where import find_database, open_joint, open_reader
from lostmotion.daemon.reader import ReaderError, open_readonly
from lostmotion.daemon.records import AlarmRow, Cause, Request, Severity, Transition, Verb
from lostmotion.drivers.terminal import printable

__all__ = ["alarms"]

LOOK_S = 0.2
COLOURS = {Severity.DEGRADED: "yellow", Severity.WARNING: "dark_orange", Severity.ERROR: "red"}


def seconds(ctx: click.Context, param: click.Parameter, value: str) -> float:
    """A length of time, a year at most."""
    try:
        length = positive(ctx, param, times.length(value)) or 0.0
    except times.TimeError as error:
        raise click.BadParameter(str(error), ctx, param) from error
    if length > requests.LONGEST_S:
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


@alarms.command("list", short_help="Alarms that are active or not acknowledged.")
@config_file
@database
@click.option("--all", "everything", is_flag=True, help="Also those that are over.")
@as_json
def alarms_list(config: Path | None, database: Path | None, everything: bool, as_json: bool) -> None:
    """Alarms that are active, acknowledged, shelved, or cleared but not acknowledged."""
    with open_reader(config, database) as reader:
        robot, alarms = reader.robot(), reader.alarms(living=not everything)
    if as_json:
        output.print_json({"robot": robot, "alarms": [documents.alarm(alarm) for alarm in alarms]})
    elif not alarms:
        output.print_lines([f"robot {robot}: no alarm"])
    else:
        columns = ("joint", "cause", "severity", "state", "raised (UTC)", "cleared", "shelved until", "reason")
        output.print_table(columns, [_row(alarm) for alarm in alarms])


@alarms.command("watch")
@config_file
@database
@duration
@click.option("--json", "as_json", is_flag=True, help="One JSON document a line.")
def alarms_watch(config: Path | None, database: Path | None, duration: float | None, as_json: bool) -> None:
    """Print each transition of an alarm as it happens."""
    end = time.monotonic() + duration if duration else math.inf
    for transition in _news(find_database(config, database), end):
        document = msgspec.json.encode(documents.transition(transition)).decode()
        sys.stdout.write((document if as_json else printable(_line(transition))) + "\n")
        sys.stdout.flush()


def _news(path: Path, end: float) -> Iterator[Transition]:
    """Transitions from now on until ``end`` [s], as they are stored; where a service has moved a damaged database
    aside, all that are in the new one."""
    file, reader = _file(path), open_readonly(path)
    last = max((number for number, _ in reader.transitions(newest=1)), default=0)
    while time.monotonic() < end:
        for number, transition in reader.transitions(after=last):
            last = number
            yield transition
        time.sleep(LOOK_S)
        if (now := _file(path)) not in (0, file):
            with suppress(ReaderError):  # it is not whole yet: at the next look
                fresh = open_readonly(path)
                reader.close()
                file, reader, last = now, fresh, 0
    reader.close()


def _file(path: Path) -> int:
    """Which file has this name; 0 for none."""
    try:
        return path.stat().st_ino
    except OSError:
        return 0


cause = click.option("--cause", type=click.Choice(["play", "device"]), help="Only this alarm of the joint.")
about_joint = combined(joint, cause, config_file, database, as_json)


@alarms.command("ack")
@about_joint
def alarms_ack(**given: Any) -> int:
    """Acknowledge the joint's alarms.  Exit status 1 if there is none."""
    return _change(Verb.ACK, **given)


@alarms.command("shelve")
@click.option(
    "--for", "for_s", default="8h", show_default=True, callback=seconds, metavar="TIME", help="30min, 8h, 2d."
)
@about_joint
def alarms_shelve(**given: Any) -> int:
    """Suppress the joint's alarms for a time, such as during work.  Exit status 1 if there is none."""
    return _change(Verb.SHELVE, **given)


@alarms.command("unshelve")
@about_joint
def alarms_unshelve(**given: Any) -> int:
    """End shelving early.  Exit status 1 if nothing is shelved."""
    return _change(Verb.UNSHELVE, **given)


def _change(
    verb: Verb,
    joint: str,
    cause: str | None,
    config: Path | None,
    database: Path | None,
    as_json: bool,
    for_s: float = 0.0,
) -> int:
    """Lets the service carry out the request, or does it here where none runs; 1 when nothing changed.

    Raises UnknownJointError, RequestError or StoreError.
    """
    request = Request(0, joint, verb, Cause(cause) if cause else None, for_s, os.environ.get("SUDO_USER") or _user())
    open_joint(joint, config, database).close()
    answer = requests.settle(find_database(config, database), request)
    if as_json:
        output.print_json({"joint": joint, "done": answer.done, "answer": answer.text})
    else:
        output.print_lines([answer.text])
    return int(not answer.done)


def _user() -> str:
    try:
        return getpass.getuser()
    except (KeyError, OSError):  # a container's user without a name
        return str(os.getuid())


def _row(alarm: AlarmRow) -> list[str]:
    from rich.markup import escape

    colour = COLOURS[alarm.severity]
    moments = [times.local(moment) if moment else "-" for moment in (alarm.raised, alarm.cleared, alarm.shelved_until)]
    severity = f"[{colour}]{alarm.severity.value}[/{colour}]"
    return [escape(alarm.joint), alarm.cause.value, severity, alarm.state.value, *moments, escape(alarm.reason)]


def _line(change: Transition) -> str:
    alarm, who = change.alarm, f" by {change.by}" if change.by else ""
    what = f"{alarm.joint} {alarm.cause.value}: {change.event.value}{who}"
    return f"{times.local(change.time)} UTC  {what} ({alarm.severity.value}, {alarm.state.value}): {alarm.reason}"
