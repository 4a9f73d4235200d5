"""The fleet's page: all robots on a Zenoh network, the worst first, and by name those that do not answer."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Iterable
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

import msgspec
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route

from lostmotion.daemon import times
from lostmotion.daemon.commands import output
from lostmotion.daemon.records import Health
from lostmotion.web.pages import json, page

if TYPE_CHECKING:
    from lostmotion.daemon.commands.fleet_ask import Fleet, FleetReply

__all__ = ["ROUTES", "Joint", "Robot", "View", "Watch", "view"]

REST_S = 3.0
"""answers of all robots are that old at most; so often they are asked, however many pages are open [s]"""
MOST_SEEN = 10_000
SILENT = "did not answer"
RANK = {health.value: rank for rank, health in enumerate((Health.ERROR, Health.WARNING, Health.DEGRADED, Health.OK))}


@dataclass(frozen=True, slots=True)
class Joint:
    """A joint of a robot, in words."""

    joint: str
    health: str
    score: str
    level: str
    severity: str
    last: str
    alarms: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Robot:
    """A robot that has answered, with the health of its worst joint; the worst joint stands first."""

    robot: str
    health: str
    joints: tuple[Joint, ...]


@dataclass(frozen=True, slots=True)
class View:
    """Robots, the worst first; missing: name of a robot or an endpoint, and why it is not among them."""

    robots: tuple[Robot, ...]
    missing: tuple[tuple[str, str], ...]


class _Alarm(msgspec.Struct, frozen=True):
    cause: str
    severity: str
    state: str
    reason: str = ""


class _Joint(msgspec.Struct, frozen=True):
    """What ``documents.joint`` writes, as far as it is shown."""

    name: str
    health: str
    score: float | None = None
    level: float | None = None
    severity: float | None = None
    last_window: datetime | None = None
    alarms: tuple[_Alarm, ...] = ()


class Watch:
    """Asks the robots when somebody looks.  A robot that has answered once is missed when it answers no more."""

    def __init__(self, fleet: Fleet) -> None:
        self._fleet = fleet
        self._seen = set(fleet.robots)
        self._lock = threading.Lock()
        self._view, self._asked = View((), ()), -math.inf

    def look(self) -> View:
        """The robots' present answers.  Takes as long as they do, a few seconds at most."""
        with self._lock:
            if time.monotonic() - self._asked >= REST_S:
                self._view = self._ask()
                self._asked = time.monotonic()
            return self._view

    def _ask(self) -> View:
        from lostmotion.daemon.commands.fleet_ask import FleetError, ask

        try:
            reply = ask(replace(self._fleet, robots=sorted(self._seen)), "status")
        except FleetError as error:
            return View((), (("Zenoh", str(error)), *((name, SILENT) for name in sorted(self._seen))))
        for name in (*(name for name, _ in reply.documents), *reply.silent):
            if len(self._seen) < MOST_SEEN:
                self._seen.add(name)
        return view(reply, datetime.now(UTC))


def view(reply: FleetReply, now: datetime) -> View:
    """The answers as they are shown."""
    robots, missing = [], [*reply.unreachable.items(), *((name, SILENT) for name in reply.silent)]
    missing += reply.errors.items()
    for name, document in reply.documents:
        try:
            robots.append(_robot(name, document, now))
        except msgspec.ValidationError as error:
            missing.append((name, f"found another answer than a robot's status ({error}); another version?"))
    return View(tuple(robot for _, robot in sorted(robots, key=lambda pair: pair[0])), tuple(missing))


Order = tuple[int, float, str]
"""rank of the health, the score as a share of the level (negative: the largest first), name"""


def _robot(name: str, document: dict[str, Any], now: datetime) -> tuple[Order, Robot]:
    joints = sorted(msgspec.convert(document.get("joints"), tuple[_Joint, ...]), key=_order)
    worst = _order(joints[0]) if joints else (len(RANK), 0.0, "")
    health = joints[0].health if joints else Health.OK.value
    return (worst[0], worst[1], name), Robot(name, health, tuple(_joint(joint, now) for joint in joints))


def _order(joint: _Joint) -> Order:
    ratio = (joint.score or 0.0) / joint.level if joint.level else 0.0
    return RANK.get(joint.health, -1), -ratio, joint.name


def _joint(joint: _Joint, now: datetime) -> Joint:
    last = joint.last_window
    return Joint(
        joint.name,
        joint.health,
        _number(joint.score),
        _number(joint.level),
        "–" if joint.severity is None else output.arcmin(joint.severity),
        times.ago(last if last.tzinfo else last.replace(tzinfo=UTC), now) if last else "no window yet",
        tuple(_alarms(joint.alarms)),
    )


def _alarms(alarms: Iterable[_Alarm]) -> Iterable[str]:
    for alarm in alarms:
        yield f"{alarm.cause} {alarm.severity} ({alarm.state})" + (f": {alarm.reason}" if alarm.reason else "")


def _number(value: float | None) -> str:
    return "–" if value is None else output.number(value)


# --- pages -----------------------------------------------------------------------------------------------------------


def show(request: Request) -> Response:
    """The page; its script asks for what stands in it."""
    _watch(request)
    return page(request, "fleet.html", title="Fleet")


def status(request: Request) -> Response:
    """The fleet as JSON."""
    return json(_watch(request).look())


def _watch(request: Request) -> Watch:
    watch: Watch | None = request.app.state.fleet
    if watch is None:
        raise HTTPException(404, "this page shows one robot; start it with --connect ENDPOINT to see the fleet")
    return watch


ROUTES = [Route("/fleet", show), Route("/api/fleet", status)]
