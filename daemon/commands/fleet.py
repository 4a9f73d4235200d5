"""``lostmotion fleet``: prints the answers of all robots, and names those that do not answer.  ``fleet_ask.py``
sends the queries."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from typing import Annotated, Any

import click
import msgspec
from msgspec import Meta, Struct

from lostmotion.daemon import documents, times
from lostmotion.daemon.commands import output
from lostmotion.daemon.commands.fleet_ask import Fleet, FleetReply, ask
from lostmotion.daemon.commands.options import (
    FILE,
    as_json,
    combined,
    config_file,
    positive,
    since,
    trend_level,
    trend_of,
    until,
)
from lostmotion.daemon.commands.trend import (
    COLUMNS,
    RADIANS,
    Of,
    TrendError,
    document,
    history_of,
    table_row,
)
from lostmotion.daemon.records import iso
from lostmotion.drivers.units import ARC_MINUTES

__all__ = ["fleet"]

NUMBERS = ("score", "level", "play", "severity")
TREND_S = 20.0
"""the default of --timeout for a trend: a small computer needs that long for two million scores [s]"""

Moment = Annotated[datetime, Meta(tz=True)]


class _Alarm(Struct, frozen=True):
    joint: str
    cause: str
    severity: str
    state: str
    raised: Moment
    reason: str


class _Joint(Struct, frozen=True):
    name: str
    health: str
    score: float | None
    level: float | None
    last_window: Moment | None
    alarms: list[_Alarm]
    play: float | None = None
    severity: float | None = None


class _Score(Struct, frozen=True):
    time: Moment
    score: float | None
    level: float | None
    impact: bool
    play: float | None
    quality: str
    severity: float | None = None


class _Status(Struct, frozen=True):
    """A robot's status, as far as it is shown."""

    joints: list[_Joint]


class _Alarms(Struct, frozen=True):
    """A list of alarms, as far as it is shown."""

    alarms: list[_Alarm]


class _History(Struct, frozen=True):
    """A list of scores, as far as it is shown."""

    scores: list[_Score]


@click.group()
def fleet() -> None:
    """Query all robots on a Zenoh network.

    Robots are searched at --connect or --zenoh, else where --config or the service's configuration connects or
    listens, else at tcp/127.0.0.1:7447.  Exit status 1 when an endpoint does not answer, or a robot that is known; 2
    when no endpoint does.
    """


def whom(timeout_s: float = 2.0) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """The options that choose the robots."""
    return combined(
        click.option(
            "--connect",
            multiple=True,
            metavar="ENDPOINT",
            help="A router or robot, such as tcp/10.0.0.1:7447; may be given more than once.",
        ),
        click.option("--zenoh", type=FILE, metavar="FILE", help="Zenoh's own configuration (JSON5): TLS and the like."),
        config_file,
        click.option("--robots", metavar="A,B", help="Robots that must answer, in addition to those that are alive."),
        click.option(
            "--timeout",
            type=float,
            default=timeout_s,
            show_default=True,
            callback=positive,
            metavar="S",
            help="Seconds to wait for answers.",
        ),
    )


@fleet.command()
@whom()
@as_json
def status(as_json: bool, **given: Any) -> int:
    """Joints, their health and active alarms, of all robots."""
    reply = _checked(ask(Fleet.of(**given), "status"), _Status)
    if as_json:
        return _json(reply, {})
    columns = ("robot", "joint", "health", *NUMBERS, "last window", "alarms")
    rows = [_status_row(robot, joint) for robot, of in reply.documents for joint in of["joints"]]
    return _table(reply, columns, rows, "no joint", right=NUMBERS)


@fleet.command()
@whom()
@as_json
def alarms(as_json: bool, **given: Any) -> int:
    """Active alarms of all robots."""
    reply = _checked(ask(Fleet.of(**given), "alarms"), _Alarms)
    if as_json:
        return _json(reply, {})
    columns = ("robot", "joint", "cause", "severity", "state", "raised (UTC)", "reason")
    rows = [_alarm_row(robot, alarm) for robot, of in reply.documents for alarm in of["alarms"]]
    return _table(reply, columns, rows, "no active alarm")


@fleet.command()
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
@whom()
@as_json
def history(joint: str, since: datetime | None, until: datetime | None, limit: int, as_json: bool, **given: Any) -> int:
    """Scores of one joint, of all robots that have it."""
    reply = _checked(ask(Fleet.of(**given), f"{joint}/history?{_query(since, until, limit=limit)}"), _History)
    if as_json:
        return _json(reply, {"joint": joint})
    columns = ("robot", "time (UTC)", "score", "level", "impact", "play", "severity", "quality")
    rows = [_score_row(robot, score) for robot, of in reply.documents for score in of["scores"]]
    return _table(reply, columns, rows, "no scores in that time", right=NUMBERS)


@fleet.command()
@click.argument("joint")
@since
@until
@trend_of
@trend_level
@whom(timeout_s=TREND_S)
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
    fleet = Fleet.of(**given)
    reply = ask(fleet, f"{joint}/series?{_query(since, until)}")
    trends, errors = [], dict(reply.errors)
    unit = RADIANS if as_json else ARC_MINUTES
    for robot, answer in reply.documents:
        try:
            series = documents.to_series(answer)
            trends.append((robot, history_of(joint, series, fleet.config, of, level, unit)))
        except (KeyError, TypeError, ValueError):
            errors[robot] = "found another answer than a series of scores; another version?"
        except TrendError as error:
            errors[robot] = str(error)
    result = replace(reply, documents=[(robot, document(one)) for robot, one in trends], errors=errors)
    if as_json:
        return _json(result, {"joint": joint})
    rows = [[robot, *table_row(one)] for robot, one in trends]
    return _table(result, ("robot", *COLUMNS), rows, "no trend", right=("count", "now", "level"))


def _checked(reply: FleetReply, form: type[_Status | _Alarms | _History]) -> FleetReply:
    """The answers of that form; another one is the error of its robot, and hides no other robot."""
    documents, errors = [], dict(reply.errors)
    for robot, answer in reply.documents:
        try:
            msgspec.convert(answer, form)
        except msgspec.ValidationError as error:
            errors[robot] = f"found another answer than was asked for ({error}); another version?"
        else:
            documents.append((robot, answer))
    return replace(reply, documents=documents, errors=errors)


def _query(since: datetime | None, until: datetime | None, **more: object) -> str:
    """The parameters of a query."""
    times.check_order(since, until)
    bounds = {key: iso(value) for key, value in (("since", since), ("until", until)) if value}
    return ";".join(f"{key}={value}" for key, value in (bounds | more).items())


def _json(reply: FleetReply, about: dict[str, Any]) -> int:
    """Prints the document of an answer; the exit status."""
    # The name is that of the key, and stands first, whatever the document has.
    robots = [{"robot": robot} | document | {"robot": robot} for robot, document in reply.documents]
    missing = {
        "silent": reply.silent,
        "errors": [{"robot": robot, "error": error} for robot, error in reply.errors.items()],
        "unreachable": [{"endpoint": endpoint, "error": error} for endpoint, error in reply.unreachable.items()],
    }
    output.print_json(about | {"robots": robots} | missing)
    return int(not reply.is_whole)


def _table(
    reply: FleetReply, columns: Sequence[str], rows: Sequence[Sequence[str]], nothing: str, right: Sequence[str] = ()
) -> int:
    """Prints the table of an answer, or that there is nothing, and who is missing in it; the exit status."""
    from rich.markup import escape

    if rows:
        output.print_table(columns, [[escape(cell) for cell in row] for row in rows], right)
    elif reply.documents:
        output.print_lines([f"{', '.join(robot for robot, _ in reply.documents)}: {nothing}"])
    output.print_lines(
        [f"{robot}: did not answer" for robot in reply.silent]
        + [f"{robot}: {error}" for robot, error in reply.errors.items()]
        + [f"{endpoint}: nobody answers there ({error})" for endpoint, error in reply.unreachable.items()]
    )
    return int(not reply.is_whole)


def _status_row(robot: str, joint: dict[str, Any]) -> list[str]:
    last = times.ago(datetime.fromisoformat(joint["last_window"]), datetime.now(UTC)) if joint["last_window"] else "-"
    alarms = ", ".join(f"{alarm['cause']} {alarm['severity']} ({alarm['state']})" for alarm in joint["alarms"])
    return [robot, joint["name"], joint["health"], *_numbers(joint), last, alarms]


def _alarm_row(robot: str, alarm: dict[str, Any]) -> list[str]:
    raised = times.local(datetime.fromisoformat(alarm["raised"]))
    return [robot, *(alarm[key] for key in ("joint", "cause", "severity", "state")), raised, alarm["reason"]]


def _score_row(robot: str, score: dict[str, Any]) -> list[str]:
    when = times.local(datetime.fromisoformat(score["time"]))
    value, level, play, severity = _numbers(score)
    return [robot, when, value, level, "impact" if score["impact"] else "", play, severity, score["quality"]]


def _numbers(of: dict[str, Any]) -> list[str]:
    """The columns ``NUMBERS`` of a joint's status or of a score; robots of an earlier version have no severity."""
    score, level, play, severity = (math.nan if of.get(key) is None else of[key] for key in NUMBERS)
    return [output.number(score), output.number(level), output.arcmin(play), output.arcmin(severity)]
