"""The content of the first page: texts and a few numbers of joints, alarms, devices and sinks, ready to be shown.

The same texts are in the page when it is loaded and in the events that keep it up to date.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from datetime import UTC, datetime

from lostmotion.daemon import times
from lostmotion.daemon.commands import output
from lostmotion.daemon.commands.reasons import others, present_reason
from lostmotion.daemon.config import ConfigError
from lostmotion.daemon.database import is_held
from lostmotion.daemon.reader import Reader
from lostmotion.daemon.records import AlarmRow, AlarmState, DeviceRow, ScoreRow, Severity, SinkRow, iso
from lostmotion.web.site import Site

__all__ = ["Alarm", "Card", "Cards", "Sink", "Trouble", "cards", "micrometres", "radii"]

FULL_SCALE = 2.0
"""a bar is full at so many times the level"""


@dataclass(frozen=True, slots=True)
class Alarm:
    """An alarm that is not normal again; can_acknowledge, is_shelved: which of the buttons are of use."""

    joint: str
    cause: str
    severity: str
    state: str
    reason: str
    since: str
    can_acknowledge: bool
    is_shelved: bool


@dataclass(frozen=True, slots=True)
class Card:
    """A joint in words; fill: the score against its level, 0 to 1, the level at 0.5; window: time of the newest one."""

    joint: str
    health: str
    reason: str
    score: str
    level: str
    fill: float
    is_impact: bool
    play: str
    severity: str
    last: str
    window: str


@dataclass(frozen=True, slots=True)
class Trouble:
    """A device that loses or lacks data, and where it is plugged in."""

    device: str
    text: str
    place: str


@dataclass(frozen=True, slots=True)
class Sink:
    """Where alarms are sent to: its name, "up", "down" or "unknown" and since when, and its last error."""

    sink: str
    state: str
    since: str
    error: str


@dataclass(frozen=True, slots=True)
class Cards:
    """The whole of the first page."""

    robot: str
    is_watched: bool
    time: str
    joints: tuple[Card, ...]
    alarms: tuple[Alarm, ...]
    troubles: tuple[Trouble, ...]
    sinks: tuple[Sink, ...]


def cards(site: Site, reader: Reader) -> Cards:
    """The cards from the database now.  Raises ReaderError, or what a damaged database raises."""
    now = datetime.now(UTC)
    gears = radii(site)
    living = reader.alarms(living=True)
    windows, origins = site.alarm.windows, reader.origins()
    joints = tuple(
        _card(
            row.name, row.health.value, present_reason(reader, row, _of(row.name, living), windows),
            reader.last_window(row.name), gears.get(row.name, math.nan), now, others(row.name, origins),
        )
        for row in reader.joints()
    )  # fmt: skip
    alarms = tuple(_alarm(alarm, now) for alarm in living)
    places = _places(site)
    troubles = tuple(found for device in reader.devices() if (found := _trouble(device, places)))
    is_watched = is_held(site.database) is not False
    sinks = tuple(_sink(row, now) for row in reader.sinks())
    return Cards(reader.robot(), is_watched, iso(now), joints, tuple(sorted(alarms, key=_worst)), troubles, sinks)


def micrometres(angle: float, radius_m: float) -> str:
    """An angle of play [rad] in arc-minutes, and in micrometres at the gear where its radius [m] is known."""
    if not math.isfinite(angle):
        return "–"
    length = f" ({angle * radius_m * 1e6:.3g} µm)" if math.isfinite(radius_m) else ""
    return output.arcmin(angle) + length


def _of(joint: str, alarms: list[AlarmRow]) -> list[AlarmRow]:
    return [alarm for alarm in alarms if alarm.joint == joint]


def _card(
    joint: str, health: str, reason: str, last: ScoreRow | None, radius_m: float, now: datetime, whose: str
) -> Card:
    if last is None:
        return Card(joint, health, reason, "–", "–", 0.0, False, "–", "–", "no window yet", "")
    ratio = last.score / last.level if math.isfinite(last.score) else 0.0
    return Card(
        joint,
        health,
        reason or ("no impact detected" if not last.impact else _impact(whose)),
        output.number(last.score) if math.isfinite(last.score) else "–",
        f"{last.level:.4g}",
        min(max(ratio, 0.0), FULL_SCALE) / FULL_SCALE,
        last.impact,
        micrometres(last.play, radius_m),
        micrometres(last.severity, radius_m),
        times.ago(last.time, now),
        iso(last.time),
    )


def _impact(whose: str) -> str:
    return f"impact at the last reversal, {whose}" if whose else "impact at the last reversal"


def _alarm(row: AlarmRow, now: datetime) -> Alarm:
    state = {
        AlarmState.ACTIVE: "active",
        AlarmState.ACKNOWLEDGED: "acknowledged",
        AlarmState.RETURNED: "over, not acknowledged",
        AlarmState.SHELVED: "shelved",
        AlarmState.NORMAL: "over",
    }[row.state]
    if row.shelved_until and row.state is AlarmState.SHELVED:
        state += f" until {times.local(row.shelved_until)} UTC"
    return Alarm(
        row.joint,
        row.cause.value,
        row.severity.value,
        state,
        row.reason,
        f"{times.local(row.raised)[:-5]} UTC, {times.ago(row.raised, now)}",
        row.state in (AlarmState.ACTIVE, AlarmState.RETURNED),
        row.state is AlarmState.SHELVED,
    )


def _worst(alarm: Alarm) -> tuple[bool, int, str]:
    rank = [Severity.ERROR.value, Severity.WARNING.value, Severity.DEGRADED.value].index(alarm.severity)
    return alarm.is_shelved, rank, alarm.joint


def _trouble(device: DeviceRow, places: dict[str, str]) -> Trouble | None:
    """What is wrong with a device now; what it lost long ago is in ``status``."""
    if not device.reason:
        return None
    return Trouble(device.name, device.reason, places.get(device.name, ""))


def _sink(row: SinkRow, now: datetime) -> Sink:
    state = {True: "up", False: "down", None: "unknown"}[row.is_up]
    since = "" if row.is_up is None else f"for {times.span(abs((now - row.since).total_seconds()))}"
    return Sink(row.name, state, since, row.error)


def _places(site: Site) -> dict[str, str]:
    try:
        return {name: place for name, place in site.places().items() if place}
    except ConfigError:
        return {}


def radii(site: Site) -> dict[str, float]:
    """The radius of each joint's gear [m], as far as it is configured."""
    try:
        return {joint.name: joint.gear_radius_m for joint in site.config().joints if joint.gear_radius_m}
    except ConfigError:
        return {}
