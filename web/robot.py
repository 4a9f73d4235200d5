"""The first page: every joint with its health, the alarms, the devices; what people do about alarms; the news."""

from __future__ import annotations

import msgspec
from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import Response, StreamingResponse
from starlette.routing import Route

from lostmotion.daemon import documents, requests
from lostmotion.daemon.reader import Reader
from lostmotion.daemon.records import Answer, Cause, Verb
from lostmotion.daemon.records import Request as AlarmRequest
from lostmotion.web.bodies import document
from lostmotion.web.cards import Cards, cards
from lostmotion.web.events import News, stream
from lostmotion.web.pages import json, page, site_of
from lostmotion.web.site import Site
from lostmotion.web.spark import Spark, spark

__all__ = ["ROUTES"]


class Asked(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A request about an alarm."""

    joint: str
    verb: Verb
    cause: Cause | None = None
    for_s: float = 0.0


def show(request: Request) -> Response:
    """The page."""
    site = site_of(request)
    with site.reader() as reader:
        found = cards(site, reader)
        sparks = _sparks(site, reader, found)
    return page(request, "robot.html", title=found.robot, robot=found, sparks=sparks)


def _sparks(site: Site, reader: Reader, found: Cards) -> dict[str, Spark]:
    limit = site.alarm.severity_warning
    return {card.joint: spark(reader, card.joint, site.spark_span, limit) for card in found.joints}


def status(request: Request) -> Response:
    """The same as JSON, and in SI units what ``lostmotion status --json`` prints."""
    site = site_of(request)
    with site.reader() as reader:
        shown: dict[str, object] = msgspec.to_builtins(cards(site, reader))
        return json(shown | {"status": documents.status(reader)})


async def events(request: Request) -> Response:
    """The news, until the page is left."""
    news: News = request.app.state.news
    try:
        queue = news.listen()
    except LookupError as error:
        raise HTTPException(503, str(error)) from error
    headers = {"cache-control": "no-store", "x-accel-buffering": "no"}
    return StreamingResponse(stream(news, queue), media_type="text/event-stream", headers=headers)


async def act(request: Request) -> Response:
    """Acknowledges, shelves or unshelves; answers when the service has."""
    asked = await document(request, Asked)
    if not (0 < asked.for_s <= requests.LONGEST_S) and asked.verb is Verb.SHELVE:
        raise HTTPException(422, f"found for_s = {asked.for_s:g}, expected seconds, a year at most")
    by = request.client.host if request.client else ""
    wish = AlarmRequest(0, asked.joint, asked.verb, asked.cause, asked.for_s, f"web, from {by}")
    answer = await run_in_threadpool(_settle, site_of(request), wish)
    return json({"done": answer.done, "answer": answer.text}, 200 if answer.done else 409)


def _settle(site: Site, wish: AlarmRequest) -> Answer:
    with site.reader() as reader:
        if wish.joint not in {row.name for row in reader.joints()}:
            raise HTTPException(404, f"no joint is called {wish.joint!r}")
    return requests.settle(site.database, wish)


ROUTES = [
    Route("/", show),
    Route("/api/status", status),
    Route("/api/events", events),
    Route("/api/alarms", act, methods=["POST"]),
]
