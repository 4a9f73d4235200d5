"""Who may see the page and who may change anything: hosts, sessions, the password, tokens, and the headers of each
answer.

Three things are checked before the application gets a request.  *Host*: without a password only names of this
computer are answered, so that no foreign page can reach the robot through another host name (DNS rebinding).
*Identity*: a session's cookie, or a program's bearer token.  *Origin*: a change must come from a page of ours and
carry its session's token (CSRF).
"""

from __future__ import annotations

import hmac
import secrets
import time
from collections import OrderedDict, deque
from collections.abc import Awaitable, Callable, MutableMapping
from dataclasses import dataclass, field
from http.cookies import CookieError, SimpleCookie
from typing import Any
from urllib.parse import urlsplit

from argon2 import PasswordHasher
from argon2.exceptions import InvalidHashError, VerificationError
from starlette.datastructures import Headers
from starlette.responses import PlainTextResponse, RedirectResponse, Response

from lostmotion.daemon.sockets import is_loopback

__all__ = ["COOKIE", "Keys", "SecurityMiddleware", "Session", "Sessions", "Throttle", "hash_password"]

COOKIE = "lostmotion_session"
IDLE_S = 12 * 3600.0
"""a session that nobody uses for a working day ends [s]"""
MOST_SESSIONS = 100
TRIES, TRIES_S = 5, 60.0
"""wrong passwords from one address within so long [s]; Argon2 takes 50 ms, so that guessing costs the robot little"""
MOST_ADDRESSES = 1000
SAFE = frozenset({"GET", "HEAD", "OPTIONS"})
HEADERS = {
    "content-security-policy": "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:;"
    " connect-src 'self'; form-action 'self'; base-uri 'none'; frame-ancestors 'none'",
    "x-content-type-options": "nosniff",
    "x-frame-options": "DENY",
    "referrer-policy": "same-origin",
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "permissions-policy": "camera=(), geolocation=(), microphone=()",
}
Scope = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[MutableMapping[str, Any]]]
Send = Callable[[MutableMapping[str, Any]], Awaitable[None]]
App = Callable[[Scope, Receive, Send], Awaitable[None]]


def hash_password(password: str) -> str:
    """The Argon2id hash of a password, for ``[web] password_hash``."""
    return PasswordHasher().hash(password)


@dataclass(frozen=True, slots=True)
class Keys:
    """What opens the page: an Argon2 hash and a program's token; "" for none.  Without either the page is open."""

    password_hash: str = ""
    token: str = ""

    @property
    def is_open(self) -> bool:
        """Whether neither password nor token is needed."""
        return not (self.password_hash or self.token)

    def is_password(self, password: str) -> bool:
        """Whether this is the password.  Takes some 50 ms."""
        try:
            return bool(self.password_hash) and PasswordHasher().verify(self.password_hash, password)
        except (VerificationError, InvalidHashError):
            return False

    def is_token(self, token: str) -> bool:
        """Whether this is the token."""
        return bool(self.token) and hmac.compare_digest(token.encode(), self.token.encode())


@dataclass(slots=True)
class Session:
    """Somebody who has given the password, or anybody where none is asked; token: what changes must carry."""

    token: str = field(default_factory=lambda: secrets.token_urlsafe(32))
    used: float = field(default_factory=time.monotonic)


class Sessions:
    """The sessions that are open, by the value of their cookies; the least used ends when there are too many."""

    def __init__(self) -> None:
        self._sessions: OrderedDict[str, Session] = OrderedDict()

    def begin(self) -> str:
        """A new session; the value of its cookie."""
        name = secrets.token_urlsafe(32)
        self._sessions[name] = Session()
        while len(self._sessions) > MOST_SESSIONS:
            self._sessions.popitem(last=False)
        return name

    def find(self, name: str) -> Session | None:
        """The session of a cookie; None where it has ended."""
        session = self._sessions.get(name)
        if session is None or time.monotonic() - session.used > IDLE_S:
            self._sessions.pop(name, None)
            return None
        session.used = time.monotonic()
        self._sessions.move_to_end(name)
        return session

    def end(self, name: str) -> None:
        """Ends a session."""
        self._sessions.pop(name, None)


class Throttle:
    """How often an address may try a password."""

    def __init__(self, tries: int = TRIES, within_s: float = TRIES_S) -> None:
        self._tries, self._within_s = tries, within_s
        self._failed: OrderedDict[str, deque[float]] = OrderedDict()

    def wait_s(self, address: str) -> float:
        """How long this address has to wait [s]; 0: not at all."""
        failed = self._failed.get(address, deque())
        while failed and failed[0] < time.monotonic() - self._within_s:
            failed.popleft()
        return 0.0 if len(failed) < self._tries else failed[0] + self._within_s - time.monotonic()

    def fail(self, address: str) -> None:
        """Notes a wrong password."""
        self._failed.setdefault(address, deque()).append(time.monotonic())
        self._failed.move_to_end(address)
        while len(self._failed) > MOST_ADDRESSES:
            self._failed.popitem(last=False)

    def forgive(self, address: str) -> None:
        """Forgets the failures after the right password."""
        self._failed.pop(address, None)


class SecurityMiddleware:
    """ASGI middleware: refuses requests that are not allowed, and adds the headers to each answer.

    ``scope["session"]`` is the Session of a request, ``scope["session_name"]`` its cookie's value.
    """

    PUBLIC = ("/login", "/static/", "/health")

    def __init__(self, app: App, keys: Keys, sessions: Sessions) -> None:
        self._app, self._keys, self._sessions = app, keys, sessions
        self._anybody = Session()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answers a request, or lets the application answer it."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        refusal = self._refusal(scope)
        await (refusal or self._app)(scope, receive, _with_headers(send, scope))

    def _refusal(self, scope: Scope) -> Response | None:
        """What is answered instead of a page; None where the request is allowed."""
        headers = Headers(scope=scope)
        if self._keys.is_open and not is_loopback(_hostname(headers.get("host", ""))):
            text = f"found the host {headers.get('host', '')[:80]!r}, expected a name of this computer\n"
            return PlainTextResponse(text, 421)
        scheme, _, token = headers.get("authorization", "").partition(" ")
        if scheme.lower() == "bearer" and self._keys.is_token(token.strip()):
            scope["session"], scope["session_name"] = Session(), ""
            return None
        name = _cookie(headers)
        session = self._anybody if self._keys.is_open else self._sessions.find(name)
        scope["session"], scope["session_name"] = session, name
        is_public = scope["path"].startswith(self.PUBLIC)
        if session is None and not is_public:
            return _please_log_in(scope, headers)
        if scope["method"] in SAFE:
            return None
        if not _is_same_origin(headers):
            return PlainTextResponse("this request comes from another page\n", 403)
        carried = headers.get("x-csrf-token", "")
        if not is_public and (session is None or not hmac.compare_digest(carried.encode(), session.token.encode())):
            return PlainTextResponse("this page is too old: load it again\n", 403)
        return None


def _please_log_in(scope: Scope, headers: Headers) -> Response:
    if scope["method"] == "GET" and "text/html" in headers.get("accept", ""):
        return RedirectResponse("/login", 303)
    return PlainTextResponse("log in first\n", 401, {"www-authenticate": "Bearer"})


def _is_same_origin(headers: Headers) -> bool:
    """Whether, by the browser's headers, one of our own pages asks; a program sends none, and carries a token."""
    site, origin = headers.get("sec-fetch-site"), headers.get("origin")
    if site not in (None, "same-origin", "none"):
        return False
    return origin is None or urlsplit(origin).netloc == headers.get("host", "")


def _hostname(host: str) -> str:
    try:
        return urlsplit(f"//{host}").hostname or ""
    except ValueError:
        return ""


def _cookie(headers: Headers) -> str:
    try:
        found = SimpleCookie(headers.get("cookie", "")).get(COOKIE)
    except CookieError:
        return ""
    return found.value if found else ""


def _with_headers(send: Send, scope: Scope) -> Send:
    """Adds the headers that every answer has, unless it has its own."""

    async def sending(message: MutableMapping[str, Any]) -> None:
        if message["type"] == "http.response.start":
            there = {name.lower() for name, _ in message["headers"]}
            added = dict(HEADERS)
            if not scope["path"].startswith("/static/"):
                added["cache-control"] = "no-store"
            if scope["scheme"] == "https":
                added["strict-transport-security"] = "max-age=31536000"
            message["headers"] = [
                *message["headers"],
                *((name.encode(), value.encode()) for name, value in added.items() if name.encode() not in there),
            ]
        await send(message)

    return sending
