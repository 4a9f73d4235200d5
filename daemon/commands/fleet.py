"""``lostmotion fleet``: every robot on a Zenoh network is asked at once; those that do not answer are named."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import zenoh

from lostmotion.daemon.commands import output, times
from lostmotion.daemon.commands.where import find_config
from lostmotion.daemon.options import ZenohOptions
from lostmotion.daemon.zenoh_session import brief, configuration, why_closed
from lostmotion.drivers.errors import LostmotionError

__all__ = ["Fleet", "FleetError", "Heard", "ask", "history", "status"]

HERE = "tcp/127.0.0.1:7447"
"""where a robot or a router listens unless told otherwise"""


class FleetError(LostmotionError):
    """Nobody can be asked."""


@dataclass(frozen=True, slots=True)
class Fleet:
    """Whom to ask, and for how long [s].  robots: names that are expected to answer besides those that are alive."""

    connect: Sequence[str] = ()
    zenoh: str = ""
    config: Path | None = None
    robots: Sequence[str] = ()
    timeout_s: float = 2.0


@dataclass(slots=True)
class Heard:
    """Documents and errors by robot; silent: who is known and has said nothing."""

    documents: dict[str, dict[str, Any]] = field(default_factory=dict)
    errors: dict[str, str] = field(default_factory=dict)
    silent: list[str] = field(default_factory=list)

    @property
    def is_whole(self) -> bool:
        return not self.errors and not self.silent


def status(fleet: Fleet, as_json: bool) -> int:
    """Prints the health of all joints of all robots; 1 when a robot did not answer.  Raises FleetError."""
    heard = ask(fleet, "status")
    if as_json:
        output.print_json({"robots": list(heard.documents.values())} | _missing(heard))
    else:
        rows = [_status_row(robot, joint) for robot, of in heard.documents.items() for joint in of["joints"]]
        columns = ("robot", "joint", "health", "score", "level", "last window", "alarms")
        output.print_table(columns, rows, right=("score", "level"))
        _print_missing(heard)
    return int(not heard.is_whole)


def history(fleet: Fleet, joint: str, parameters: dict[str, str], as_json: bool) -> int:
    """Prints the scores of one joint of all robots; 1 when a robot did not answer, or has no such joint."""
    selector = f"{joint}/history?" + ";".join(f"{key}={value}" for key, value in parameters.items())
    heard = ask(fleet, selector)
    if as_json:
        robots = [{"robot": robot} | document for robot, document in heard.documents.items()]
        output.print_json({"joint": joint, "robots": robots} | _missing(heard))
    else:
        rows = [_score_row(robot, score) for robot, of in heard.documents.items() for score in of["scores"]]
        output.print_table(
            ("robot", "time (UTC)", "score", "level", "impact", "play", "quality"), rows, ("score", "level")
        )
        _print_missing(heard)
    return int(not heard.is_whole)


def ask(fleet: Fleet, selector: str) -> Heard:
    """Asks all robots for a key, and at the same time who is alive.  Raises FleetError."""
    heard = Heard()
    with _session(fleet) as session:
        replies = session.get(f"lostmotion/*/{selector}", target=zenoh.QueryTarget.ALL, timeout=fleet.timeout_s)
        alive = session.liveliness().get("lostmotion/*/alive", timeout=fleet.timeout_s)
        known = {_robot(reply.ok.key_expr) for reply in alive if reply.ok} | set(fleet.robots)
        for reply in replies:
            if reply.ok:
                heard.documents[_robot(reply.ok.key_expr)] = json.loads(reply.ok.payload.to_bytes())
            elif reply.err and str(reply.err.encoding) == "application/json":
                error = json.loads(reply.err.payload.to_bytes())
                heard.errors[error["robot"]] = error["error"]
    heard.documents = dict(sorted(heard.documents.items()))
    heard.silent = sorted(known - set(heard.documents) - set(heard.errors))
    if not known and not heard.documents:
        raise FleetError(f"{_where(fleet)}: no robot there; is its [alarm.zenoh] connected to the same router?")
    return heard


@contextmanager
def _session(fleet: Fleet) -> Iterator[zenoh.Session]:
    try:
        config = configuration(_options(fleet))
        config.insert_json5("transport/unicast/open_timeout", str(round(fleet.timeout_s * 1000)))
    except zenoh.ZError as error:
        raise FleetError(f"{_options(fleet).config}: no valid configuration of Zenoh: {brief(error)}") from error
    try:
        session = zenoh.open(config)
    except zenoh.ZError as error:
        why = why_closed(_options(fleet), error)
        raise FleetError(f"{_where(fleet)}: nobody answers there, expected a router or a robot ({why})") from error
    try:
        yield session
    finally:
        session.close()  # type: ignore[no-untyped-call]


def _options(fleet: Fleet) -> ZenohOptions:
    """A client at the endpoints that were given, else where a robot's configuration connects or listens."""
    if fleet.zenoh:
        return ZenohOptions(config=fleet.zenoh, connect=list(fleet.connect))
    robot = find_config(fleet.config).zenoh or ZenohOptions()
    return ZenohOptions(
        mode="client", connect=list(fleet.connect) or robot.connect or robot.listen or [HERE], config=robot.config
    )


def _where(fleet: Fleet) -> str:
    options = _options(fleet)
    return ", ".join(options.connect) or options.config


def _robot(key: zenoh.KeyExpr) -> str:
    return str(key).split("/")[1]


def _missing(heard: Heard) -> dict[str, Any]:
    errors = [{"robot": robot, "error": error} for robot, error in sorted(heard.errors.items())]
    return {"silent": heard.silent, "errors": errors}


def _print_missing(heard: Heard) -> None:
    lines = [f"{robot}: did not answer" for robot in heard.silent]
    output.print_lines(lines + [f"{robot}: {error}" for robot, error in sorted(heard.errors.items())])


def _status_row(robot: str, joint: dict[str, Any]) -> list[str]:
    last = times.ago(datetime.fromisoformat(joint["last_window"]), datetime.now(UTC)) if joint["last_window"] else "-"
    alarms = ", ".join(f"{alarm['cause']} {alarm['severity']} ({alarm['state']})" for alarm in joint["alarms"])
    numbers = [_number(joint["score"]), _number(joint["level"])]
    return [robot, joint["name"], joint["health"], *numbers, last, alarms]


def _score_row(robot: str, score: dict[str, Any]) -> list[str]:
    when = times.local(datetime.fromisoformat(score["time"]))
    play = output.arcmin(math.nan if score["play"] is None else score["play"])
    impact = "impact" if score["impact"] else ""
    return [robot, when, _number(score["score"]), _number(score["level"]), impact, play, score["quality"]]


def _number(value: float | None) -> str:
    return output.number(math.nan if value is None else value)
