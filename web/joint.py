"""A joint's page: its history as far as it is kept, the trend, and the raw window behind any point of the plot."""

from __future__ import annotations

import math
from datetime import UTC, datetime, timedelta
from typing import Any

from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route

from lostmotion.daemon import documents, times
from lostmotion.daemon.commands.reasons import others
from lostmotion.daemon.commands.trend import RADIANS, document, history_of, words
from lostmotion.daemon.config import ConfigError
from lostmotion.daemon.extremes import EXTREMES
from lostmotion.daemon.reader import Reader
from lostmotion.daemon.records import AlarmEvent, ScoreRow
from lostmotion.detector.trend import MOST
from lostmotion.detector.window import DetectorSettings
from lostmotion.web.cards import cards, radii
from lostmotion.web.pages import json, page, site_of
from lostmotion.web.site import Site
from lostmotion.web.windows import Picture, csv, picture

__all__ = ["ROUTES"]

PIECES = 800
"""pieces of time on a plot, about one a pixel"""
MOST_PIECES = 4000
MOST_WINDOWS = 400
"""marks of kept windows on a plot"""
MARKED = (AlarmEvent.RAISED, AlarmEvent.ESCALATED, AlarmEvent.CLEARED, AlarmEvent.ACKNOWLEDGED)


def show(request: Request) -> Response:
    """The page."""
    site, name = site_of(request), request.path_params["joint"]
    with _open(site, name) as reader:
        found = cards(site, reader)
    card = next(card for card in found.joints if card.joint == name)
    alarms = [alarm for alarm in found.alarms if alarm.joint == name]
    return page(request, "joint.html", title=name, joint=card, alarms=alarms, robot=found.robot)


def series(request: Request) -> Response:
    """The history between two times, the least, median and largest values in each of many pieces; where raw windows are
    kept and what has happened to alarms."""
    site, name = site_of(request), request.path_params["joint"]
    pieces = _whole(request, "pieces", PIECES, MOST_PIECES)
    with _open(site, name) as reader:
        extent = reader.extent(name)
        if extent is None:
            return json({"joint": name, "first": None, "last": None, "columns": {key: [] for key in EXTREMES}})
        since, until = _span(request, extent)
        rows = reader.extremes(name, since, until, pieces)
        windows = reader.window_times(name, since, until, MOST_WINDOWS)
        events = [event for _, event in reader.transitions(name) if since <= event.time < until]
    columns = (
        dict(zip(EXTREMES, map(list, zip(*rows, strict=True)), strict=True)) if rows else {k: [] for k in EXTREMES}
    )
    return json(
        {
            "joint": name,
            "first": extent[0].timestamp(),
            "last": extent[1].timestamp(),
            "columns": columns,
            "windows": [[time.timestamp(), impact] for time, impact in windows],
            "events": [
                [event.time.timestamp(), event.event.value, event.alarm.severity.value, event.alarm.reason]
                for event in events
                if event.event in MARKED
            ],
        }
    )


def trend(request: Request) -> Response:
    """The trend of severities (of scores where there are none) with its forecast, as ``lostmotion trend`` has it, in
    numbers and in words."""
    site, name = site_of(request), request.path_params["joint"]
    with _open(site, name) as reader:
        columns, whose = reader.series(name, most=MOST), others(name, reader.origins())
    history = history_of(name, columns, site.config_file, None, None, RADIANS)
    line = history.wear.recent
    shown = history_of(name, columns, site.config_file, None, None)
    return json(
        document(history)
        | {
            "line": {"start": history.start.timestamp(), "slope": line.slope, "intercept": line.intercept},
            "words": words(shown, radii(site).get(name, math.nan), whose),
        }
    )


def window(request: Request) -> Response:
    """The kept raw window nearest to a time: wave, spectrum, and the bands of eqs. 8 and 10; ``format=csv``: a
    recording."""
    site, name = site_of(request), request.path_params["joint"]
    with _open(site, name) as reader:
        time = _time(request, "time") or datetime.now(UTC)
        row = reader.window(name, time)
        if row is None:
            raise HTTPException(404, "no raw window of this joint is kept (store.keep_windows_mb)")
        score = reader.score_at(name, row.time)
    settings = _settings(site, name)
    if request.query_params.get("format") == "csv":
        stamp = f"{row.time:%Y%m%dT%H%M%S}"
        headers = {"content-disposition": f'attachment; filename="window-{stamp}.csv"'}
        return Response(csv(row, settings), media_type="text/csv", headers=headers)
    return json(_document(picture(row, settings), score))


def _document(found: Picture, score: ScoreRow | None) -> dict[str, Any]:
    return {"picture": found, "score": documents.score(score) if score else None}


def _settings(site: Site, joint: str) -> DetectorSettings | None:
    """The detector's settings of a joint; None where the configuration knows it no more."""
    try:
        return site.config().settings(joint)
    except ConfigError:
        return None


def _open(site: Site, joint: str) -> Reader:
    """The database, which must know the joint."""
    reader = site.reader()
    if joint not in {row.name for row in reader.joints()}:
        reader.close()
        raise HTTPException(404, f"no joint is called {joint!r}")
    return reader


def _span(request: Request, extent: tuple[datetime, datetime]) -> tuple[datetime, datetime]:
    """The times that are asked for, else all, the last window included."""
    since = _time(request, "since") or extent[0]
    until = _time(request, "until") or extent[1] + timedelta(microseconds=1)
    if until <= since:
        raise HTTPException(422, "found until before since, expected it later")
    return since, until


def _time(request: Request, key: str) -> datetime | None:
    """Seconds since 1970, or what ``--since`` takes."""
    text = request.query_params.get(key, "")
    if not text:
        return None
    try:
        return datetime.fromtimestamp(float(text), UTC)
    except (ValueError, OverflowError, OSError):
        pass
    try:
        return times.parse(text, datetime.now(UTC))
    except times.TimeError as error:
        raise HTTPException(422, str(error)) from error


def _whole(request: Request, key: str, default: int, most: int) -> int:
    text = request.query_params.get(key, str(default))
    if not text.isdecimal() or not 1 <= int(text) <= most:
        raise HTTPException(422, f"{key}: found {text[:20]!r}, expected a whole number from 1 to {most}")
    return int(text)


ROUTES = [
    Route("/joints/{joint:str}", show),
    Route("/api/joints/{joint:str}/series", series),
    Route("/api/joints/{joint:str}/trend", trend),
    Route("/api/joints/{joint:str}/window", window),
]
