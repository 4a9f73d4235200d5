"""The application: its routes and its middleware."""

from __future__ import annotations

from collections.abc import AsyncIterator, Mapping
from contextlib import asynccontextmanager
from functools import partial
from pathlib import Path
from typing import Any

from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.middleware import Middleware
from starlette.middleware.gzip import GZipMiddleware
from starlette.requests import ClientDisconnect, Request
from starlette.responses import PlainTextResponse, Response
from starlette.routing import BaseRoute, Mount, Route
from starlette.staticfiles import StaticFiles

from lostmotion.drivers.errors import LostmotionError
from lostmotion.web import calibrate, fleet, joint, lab, lab_record, login, robot
from lostmotion.web.calibration import Calibration
from lostmotion.web.events import News
from lostmotion.web.pages import trouble
from lostmotion.web.security import Keys, SecurityMiddleware, Sessions, Throttle
from lostmotion.web.site import Site

__all__ = ["create_app"]

HERE = Path(__file__).parent
UPLOT = HERE.parent / "lab" / "report" / "assets"
SMALLEST_ZIPPED = 1000


def create_app(site: Site, keys: Keys) -> Starlette:
    """The ASGI application of a robot's page."""
    sessions = Sessions()
    security = Middleware(SecurityMiddleware, keys=keys, sessions=sessions)
    app = Starlette(
        routes=[*_routes()],
        middleware=[security, Middleware(GZipMiddleware, minimum_size=SMALLEST_ZIPPED)],
        exception_handlers={
            HTTPException: _http_error,
            ClientDisconnect: _gone,
            LostmotionError: trouble,
            Exception: trouble,
        },
        lifespan=partial(_lifespan, site),
    )
    app.state.fleet = fleet.Watch(site.fleet) if site.fleet else None
    app.state.site, app.state.keys, app.state.sessions, app.state.throttle = site, keys, sessions, Throttle()
    return app


def _routes() -> list[BaseRoute]:
    return [
        *robot.ROUTES,
        *joint.ROUTES,
        *calibrate.ROUTES,
        *lab.ROUTES,
        *lab_record.ROUTES,
        *login.ROUTES,
        *fleet.ROUTES,
        Route("/health", _health),
        Mount("/static/uplot", StaticFiles(directory=UPLOT)),
        Mount("/static", StaticFiles(directory=HERE / "static")),
    ]


@asynccontextmanager
async def _lifespan(site: Site, app: Starlette) -> AsyncIterator[Mapping[str, Any]]:
    app.state.news, app.state.calibration = News(site), Calibration(site)
    try:
        yield {}
    finally:
        app.state.news.close()
        app.state.calibration.close()


async def _health(request: Request) -> Response:
    """For proxies and systemd: this process answers."""
    return PlainTextResponse("ok\n")


async def _http_error(request: Request, error: Exception) -> Response:
    assert isinstance(error, HTTPException)
    return await trouble(request, error, status=error.status_code)


async def _gone(request: Request, error: Exception) -> Response:
    """Who asked has left before the end of the request: nobody reads the answer, and it is no error of the server."""
    return PlainTextResponse("the request has no end\n", 400)
