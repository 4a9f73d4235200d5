"""Logging in and out."""

from __future__ import annotations

from urllib.parse import parse_qs

from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import RedirectResponse, Response
from starlette.routing import Route

from lostmotion.web.bodies import read
from lostmotion.web.pages import page
from lostmotion.web.security import COOKIE, IDLE_S, Keys, Sessions, Throttle

__all__ = ["ROUTES"]

MOST_BODY = 4096


async def ask(request: Request) -> Response:
    """The form."""
    if request.app.state.keys.is_open:
        return RedirectResponse("/", 303)
    return page(request, "login.html", title="Log in", wrong="")


async def enter(request: Request) -> Response:
    """Checks the password and begins a session."""
    keys: Keys = request.app.state.keys
    throttle: Throttle = request.app.state.throttle
    sessions: Sessions = request.app.state.sessions
    address = request.client.host if request.client else ""
    wait_s = throttle.wait_s(address)
    if wait_s > 0:
        words = f"too many wrong passwords: wait {wait_s:.0f} s"
        return page(request, "login.html", 429, title="Log in", wrong=words)
    throttle.fail(address)  # before the check: tries at the same time count, too
    if not await run_in_threadpool(keys.is_password, await _password(request)):
        return page(request, "login.html", 401, title="Log in", wrong="this is not the password")
    throttle.forgive(address)
    sessions.end(request.scope.get("session_name", ""))
    answer = RedirectResponse("/", 303)
    answer.set_cookie(
        COOKIE, sessions.begin(), max_age=int(IDLE_S), httponly=True, samesite="strict",
        secure=request.url.scheme == "https",
    )  # fmt: skip
    return answer


async def leave(request: Request) -> Response:
    """Ends the session."""
    request.app.state.sessions.end(request.scope.get("session_name", ""))
    answer = RedirectResponse("/login", 303)
    answer.delete_cookie(COOKIE)
    return answer


async def _password(request: Request) -> str:
    return parse_qs((await read(request, MOST_BODY)).decode(errors="replace")).get("password", [""])[0]


ROUTES = [
    Route("/login", ask),
    Route("/login", enter, methods=["POST"]),
    Route("/logout", leave, methods=["POST"]),
]
