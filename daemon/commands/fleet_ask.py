"""One query to every robot that the endpoints of a Zenoh network know.  ``fleet.py``
prints the answers.

A session in Zenoh's client mode uses one of its endpoints, so each endpoint is asked in a session of its own, all at
the same time.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import zenoh
from msgspec.structs import replace

from lostmotion.daemon.commands.where import find_config
from lostmotion.daemon.crosscheck import check_endpoints
from lostmotion.daemon.options import ZenohOptions
from lostmotion.daemon.zenoh_session import SCHEMA, brief, configuration, connect_endpoints, why_closed
from lostmotion.drivers.errors import LostmotionError

__all__ = ["Fleet", "FleetError", "FleetReply", "ask"]

HERE = "tcp/127.0.0.1:7447"
"""where a robot or a router listens by default"""
NOBODY = "a robot without a name"
AT_ONCE = 32
"""endpoints that are asked at the same time, each by a thread"""


class FleetError(LostmotionError):
    """No robot can be queried."""


@dataclass(frozen=True, slots=True)
class Fleet:
    """The robots to query, and the timeout [s].  robots: names expected to answer besides those that are alive."""

    connect: Sequence[str] = ()
    zenoh: str = ""
    config: Path | None = None
    robots: Sequence[str] = ()
    timeout_s: float = 2.0

    @classmethod
    def of(
        cls, connect: Sequence[str], zenoh: Path | None, config: Path | None, robots: str | None, timeout: float = 2.0
    ) -> Fleet:
        """That of the options of a command.  Raises CrossCheckError."""
        check_endpoints("--connect", connect)
        names = [name.strip() for name in (robots or "").split(",") if name.strip()]
        return cls(connect, str(zenoh or ""), config, names, timeout)


@dataclass(frozen=True, slots=True)
class FleetReply:
    """Documents of the robots, sorted by the robots' names, and errors by robot; silent: robots that are known and have
    not answered; unreachable: why no session opened, by endpoint."""

    documents: Sequence[tuple[str, dict[str, Any]]]
    errors: dict[str, str]
    silent: Sequence[str]
    unreachable: dict[str, str]

    @property
    def is_whole(self) -> bool:
        """Whether every endpoint and every robot has answered."""
        return not (self.errors or self.silent or self.unreachable)


@dataclass(slots=True)
class _Answers:
    """What came by way of one endpoint.  A robot's key holds its name and the id of its session: robots that share a
    name stay apart, and one that is reached by two endpoints counts once."""

    alive: set[str] = field(default_factory=set)
    documents: dict[tuple[str, str], dict[str, Any]] = field(default_factory=dict)
    errors: dict[str, str] = field(default_factory=dict)
    unreachable: str = ""


def ask(fleet: Fleet, selector: str) -> FleetReply:
    """Asks all robots for a key, and at the same time who is alive.  Raises FleetError when there is no robot."""
    options = _options(fleet)
    endpoints = _endpoints(options)
    with ThreadPoolExecutor(min(len(endpoints), AT_ONCE)) as pool:
        answers = list(pool.map(lambda endpoint: _ask_at(fleet, options, endpoint, selector), endpoints))
    unreachable = {
        endpoint: answer.unreachable for endpoint, answer in zip(endpoints, answers, strict=True) if answer.unreachable
    }
    where = ", ".join(filter(None, endpoints)) or options.config
    if len(unreachable) == len(endpoints):
        why = "; ".join(dict.fromkeys(unreachable.values()))
        raise FleetError(f"{where}: nobody answers there, expected a router or a robot ({why})")
    return _together(fleet, answers, unreachable, where)


def _together(fleet: Fleet, answers: Sequence[_Answers], unreachable: dict[str, str], where: str) -> FleetReply:
    documents = {robot: document for answer in answers for robot, document in answer.documents.items()}
    errors = {robot: error for answer in answers for robot, error in answer.errors.items()}
    names = [name for name, _ in documents]
    errors |= {
        name: f"{names.count(name)} robots answer to this name; is robot.name the same in two configurations?"
        for name in names
        if names.count(name) > 1
    }
    known = set(fleet.robots).union(*(answer.alive for answer in answers))
    if not (known or documents or errors or unreachable):
        raise FleetError(f"{where}: no robot there; is its [alarm.zenoh] connected to the same router?")
    by_name = sorted(((name, document) for (name, _), document in documents.items()), key=lambda pair: pair[0])
    return FleetReply(by_name, dict(sorted(errors.items())), sorted(known - set(names) - set(errors)), unreachable)


def _ask_at(fleet: Fleet, options: ZenohOptions, endpoint: str, selector: str) -> _Answers:
    """Asks in a session with one endpoint; "" leaves the endpoints to Zenoh's own file."""
    answers = _Answers()
    try:
        with zenoh.open(_client(fleet, options, endpoint)) as session:
            replies = session.get(
                f"lostmotion/*/{selector}",
                target=zenoh.QueryTarget.ALL,
                consolidation=zenoh.ConsolidationMode.NONE,  # else one of two robots of the same name stays unseen
                timeout=fleet.timeout_s,
            )
            alive = session.liveliness().get("lostmotion/*/alive", timeout=fleet.timeout_s)
            answers.alive = {_robot(reply.ok.key_expr) for reply in alive if reply.ok}
            _collect(replies, answers)
    except zenoh.ZError as error:
        alone = replace(options, connect=[endpoint]) if endpoint else options
        why = why_closed(alone, error)
        answers.unreachable = why.removeprefix(f"nobody answers at {endpoint.partition('#')[0]}: ")
    return answers


def _collect(replies: Iterable[zenoh.Reply], answers: _Answers) -> None:
    for reply in replies:
        if reply.ok:
            robot, document = _robot(reply.ok.key_expr), _document(reply.ok.payload)
            if document:
                answers.documents[robot, str(reply.replier_id and reply.replier_id.zid)] = document
            else:
                answers.errors[robot] = f"found another answer than a document with schema {SCHEMA}; another version?"
        elif reply.err and (error := _document(reply.err.payload)):  # Zenoh's own errors are of no robot
            answers.errors[str(error.get("robot", NOBODY))] = str(error.get("error", "an error without words"))


def _document(content: zenoh.ZBytes) -> dict[str, Any]:
    """A robot's document; {} for what is none."""
    try:
        document = json.loads(content.to_bytes())
    except ValueError:
        return {}
    return document if isinstance(document, dict) and document.get("schema") == SCHEMA else {}


def _options(fleet: Fleet) -> ZenohOptions:
    """A client at the endpoints that were given, else where a robot's configuration connects or listens."""
    if fleet.zenoh:
        return ZenohOptions(config=fleet.zenoh, connect=list(fleet.connect))
    robot = find_config(fleet.config).zenoh or ZenohOptions()
    connect = list(fleet.connect) or robot.connect or robot.listen or ([] if robot.config else [HERE])
    return ZenohOptions(mode="client", connect=connect, config=robot.config)


def _endpoints(options: ZenohOptions) -> list[str]:
    """The endpoints to query; [""]: Zenoh's own file names no endpoint, but may look for some."""
    try:
        return connect_endpoints(configuration(options)) or [""]
    except zenoh.ZError as error:
        raise FleetError(f"{options.config}: no valid configuration of Zenoh: {brief(error)}") from error


def _client(fleet: Fleet, options: ZenohOptions, endpoint: str) -> zenoh.Config:
    config = configuration(options)
    config.insert_json5("transport/unicast/open_timeout", str(round(fleet.timeout_s * 1000)))
    if endpoint:
        config.insert_json5("mode", '"client"')
        config.insert_json5("connect/endpoints", json.dumps([endpoint]))
        config.insert_json5("listen/endpoints", "[]")
    return config


def _robot(key: zenoh.KeyExpr) -> str:
    return str(key).split("/")[1]
