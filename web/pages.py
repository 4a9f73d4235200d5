"""How a page is made: templates with every text escaped, JSON, and what is shown when something is wrong."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import msgspec
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import HTMLResponse, Response

from lostmotion import __version__
from lostmotion.daemon.database import DAMAGED
from lostmotion.drivers.errors import LostmotionError
from lostmotion.web.site import Site

__all__ = ["json", "page", "site_of", "trouble", "wants_html"]

FLEET = "/fleet"
NAVIGATION = (("/", "Robot"), ("/calibrate", "Calibrate"), ("/lab", "Lab"), (FLEET, "Fleet"))
"""address and name of the pages that every page leads to; to the fleet where one is asked"""
TEMPLATES = Environment(
    loader=FileSystemLoader(Path(__file__).parent / "templates"),
    autoescape=True,
    undefined=StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
)


def page(request: Request, template: str, status: int = 200, **values: Any) -> Response:
    """A page of the robot."""
    session = request.scope.get("session")
    text = TEMPLATES.get_template(template).render(
        csrf=session.token if session else "",
        navigation=[place for place in NAVIGATION if place[0] != FLEET or request.app.state.fleet],
        here=request.url.path,
        version=__version__,
        is_open=request.app.state.keys.is_open,
        **values,
    )
    return HTMLResponse(text, status)


def json(document: Any, status: int = 200) -> Response:
    """A JSON document; NaN and infinities are null."""
    return Response(msgspec.json.encode(document), status, media_type="application/json")


def site_of(request: Request) -> Site:
    """The robot that a request is about."""
    site: Site = request.app.state.site
    return site


def wants_html(request: Request) -> bool:
    """Whether a person asks, and not a script."""
    return "text/html" in request.headers.get("accept", "")


async def trouble(request: Request, error: Exception, status: int = 0) -> Response:
    """The answer to an error, for a person or a script: one sentence, never a traceback.

    An error of ours may have the status of its answer; else it is the server's.
    """
    known = (LostmotionError, *DAMAGED, OSError)
    if isinstance(error, HTTPException):
        text = str(error.detail)
    elif isinstance(error, known):
        text, status = " ".join(str(error).split()), status or getattr(error, "status", 503)
    else:
        text, status = f"internal error: {type(error).__name__}: {error}", 500
    if wants_html(request):
        title = "Not found" if status == 404 else "Something is wrong"
        return page(request, "trouble.html", status, title=title, text=text)
    return json({"error": text}, status)
