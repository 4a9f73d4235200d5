"""Recording from the lab's page: the command ``record`` as a job, while no service has the ports."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated

import msgspec
from msgspec import Meta
from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route

from lostmotion.daemon import config as configuration
from lostmotion.daemon.database import is_held
from lostmotion.web.bodies import document
from lostmotion.web.lab import LONGEST_S, PROGRAM, Lab, lab_of
from lostmotion.web.pages import json, site_of
from lostmotion.web.site import Site

__all__ = ["ROUTES"]

BUILT_IN = Path(configuration.__file__).parent / "simulated.toml"


class Asked(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What is to be recorded, for how long."""

    joint: Annotated[str, Meta(max_length=200)]
    seconds: Annotated[float, Meta(gt=0, le=LONGEST_S)]


async def begin(request: Request) -> Response:
    """Begins to record."""
    asked = await document(request, Asked)
    return json({"id": await run_in_threadpool(_begin, site_of(request), lab_of(request), asked)}, 201)


def _begin(site: Site, lab: Lab, asked: Asked) -> str:
    if asked.joint not in {joint.name for joint in site.config().joints}:
        raise HTTPException(404, f"no joint is called {asked.joint[:60]!r}")
    if is_held(site.database):
        raise HTTPException(409, "the service is running and has the ports: stop it first (systemctl stop lostmotion)")
    lab.shelf.folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    name = lab.shelf.free(f"{asked.joint}-{datetime.now(UTC):%Y%m%dT%H%M%S}.csv")
    config = (site.config_file or BUILT_IN).resolve()
    command = [*PROGRAM, "record", "--config", str(config), "--joint", asked.joint, "--duration", f"{asked.seconds:g}",
               "-o", str(lab.shelf.folder / name), "--json"]  # fmt: skip
    about = {"kind": "record", "joint": asked.joint, "seconds": asked.seconds, "recordings": [name]}
    return lab.jobs.start(lab.jobs.new(), [command], Path.cwd(), about, nice=0)  # it must keep up with the robot


ROUTES = [Route("/api/lab/record", begin, methods=["POST"])]
