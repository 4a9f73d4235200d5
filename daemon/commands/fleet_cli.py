"""The arguments of ``lostmotion fleet``; the commands are in ``fleet.py``."""

from __future__ import annotations

from collections.abc import Callable
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import Any

import click

from lostmotion.daemon import times
from lostmotion.daemon.cli import FILE, as_json, config_file, positive, since, trend_level, trend_of, until
from lostmotion.daemon.commands import fleet as answers
from lostmotion.daemon.commands.fleet_ask import Fleet
from lostmotion.daemon.commands.trend import Of
from lostmotion.daemon.crosscheck import check_endpoints
from lostmotion.daemon.records import iso

__all__ = ["fleet"]


TREND_S = 20.0
"""two million scores take a small computer that long"""


@click.group()
def fleet() -> None:
    """Query all robots on a Zenoh network.

    Robots are searched at --connect or --zenoh, else where --config or the service's configuration connects or
    listens, else at tcp/127.0.0.1:7447.  Exit status 1 when an endpoint does not answer, or a robot that is known; 2
    when no endpoint does.
    """


def whom(command: Callable[..., Any], timeout_s: float = 2.0) -> Callable[..., Any]:
    """The options that choose the robots."""
    for option in (
        click.option(
            "--timeout",
            type=float,
            default=timeout_s,
            show_default=True,
            callback=positive,
            metavar="S",
            help="Seconds to wait for answers.",
        ),
        click.option("--robots", metavar="A,B", help="Robots that must answer, in addition to those that are alive."),
        config_file,
        click.option("--zenoh", type=FILE, metavar="FILE", help="Zenoh's own configuration (JSON5): TLS and the like."),
        click.option(
            "--connect",
            multiple=True,
            metavar="ENDPOINT",
            help="A router or robot, such as tcp/10.0.0.1:7447; may be given more than once.",
        ),
    ):
        command = option(command)
    return command


@fleet.command("status")
@whom
@as_json
def status(as_json: bool, **given: Any) -> int:
    """Joints, their health and active alarms, of all robots."""
    return answers.status(_fleet(**given), as_json)


@fleet.command("alarms")
@whom
@as_json
def alarms(as_json: bool, **given: Any) -> int:
    """Active alarms of all robots."""
    return answers.alarms(_fleet(**given), as_json)


@fleet.command("history")
@click.argument("joint")
@since
@until
@click.option(
    "--limit",
    type=click.IntRange(1, 10_000),
    default=1000,
    show_default=True,
    metavar="N",
    help="The newest N of each robot.",
)
@whom
@as_json
def history(joint: str, since: datetime | None, until: datetime | None, limit: int, as_json: bool, **given: Any) -> int:
    """Scores of one joint, of all robots that have it."""
    return answers.history(_fleet(**given), joint, _bounds(since, until) | {"limit": str(limit)}, as_json)


@fleet.command("trend")
@click.argument("joint")
@since
@until
@trend_of
@trend_level
@partial(whom, timeout_s=TREND_S)
@as_json
def trend(
    joint: str,
    since: datetime | None,
    until: datetime | None,
    of: Of | None,
    level: float | None,
    as_json: bool,
    **given: Any,
) -> int:
    """Wear of one joint, of all robots that have it."""
    return answers.trend(_fleet(**given), joint, _bounds(since, until), of, level, as_json)


def _bounds(since: datetime | None, until: datetime | None) -> dict[str, str]:
    """As parameters of a query."""
    times.check_order(since, until)
    return {key: iso(value) for key, value in (("since", since), ("until", until)) if value}


def _fleet(
    connect: tuple[str, ...], zenoh: Path | None, config: Path | None, robots: str | None, timeout: float
) -> Fleet:
    check_endpoints("--connect", connect)
    names = [name.strip() for name in (robots or "").split(",") if name.strip()]
    return Fleet(connect, str(zenoh or ""), config, names, timeout)
