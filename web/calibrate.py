"""The page that leads through a calibration: the joint, the bar, the motion, and the lines that change."""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec
from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route

from lostmotion.drivers.errors import LostmotionError
from lostmotion.web.bodies import document
from lostmotion.web.calibration import Calibration, Step
from lostmotion.web.pages import json, page, site_of

__all__ = ["ROUTES"]


class Asked(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A request: ``begin`` needs joint and step, ``write`` and ``undo`` the digest of what was shown."""

    verb: Literal["begin", "end", "forget", "write", "undo"]
    joint: str = ""
    step: Step = "taps"
    false_alarm: Annotated[float, msgspec.Meta(gt=0, le=0.5)] = 0.01
    digest: str = ""


def show(request: Request) -> Response:
    """The page."""
    site = site_of(request)
    config = site.config()
    joints = [(joint.name, config.accelerometer(joint.accelerometer)) for joint in config.joints]
    chosen = request.query_params.get("joint", "")
    name = site.config_file.name if site.config_file else ""
    return page(request, "calibrate.html", title="Calibrate", joints=joints, chosen=chosen, file=name)


def state(request: Request) -> Response:
    """How far it is, as JSON."""
    return json(_calibration(request).look())


async def act(request: Request) -> Response:
    """Does what is asked; returns the state after it."""
    asked = await document(request, Asked)
    by = f"web, from {request.client.host if request.client else ''}"
    calibration = _calibration(request)
    try:
        await run_in_threadpool(_do, calibration, asked, by)
    except LostmotionError as error:
        raise HTTPException(409, " ".join(str(error).split())) from error
    return json(await run_in_threadpool(calibration.look))


def _do(calibration: Calibration, asked: Asked, by: str) -> None:
    match asked.verb:
        case "begin":
            calibration.begin(asked.joint, asked.step, asked.false_alarm, by)
        case "end":
            calibration.end()
        case "forget":
            calibration.forget()
        case "write":
            calibration.write(asked.digest, by)
        case "undo":
            calibration.take_back(asked.digest, by)


def _calibration(request: Request) -> Calibration:
    found: Calibration = request.app.state.calibration
    return found


ROUTES = [
    Route("/calibrate", show),
    Route("/api/calibrate", state),
    Route("/api/calibrate", act, methods=["POST"]),
]
