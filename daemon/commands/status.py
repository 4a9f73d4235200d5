"""``lostmotion status``: the joints, their health, and active alarms."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from lostmotion.daemon.commands import output, times
from lostmotion.daemon.commands.where import open_reader
from lostmotion.daemon.reader import Reader
from lostmotion.daemon.records import AlarmRow, DeviceRow, Health, JointRow, ScoreRow, iso

__all__ = ["status"]

COLOURS = {Health.OK: "green", Health.DEGRADED: "yellow", Health.WARNING: "dark_orange", Health.ERROR: "red"}


@dataclass(frozen=True, slots=True)
class JointStatus:
    """One joint as the database has it."""

    joint: JointRow
    last: ScoreRow | None
    alarms: list[AlarmRow]


def status(config: Path | None, database: Path | None, fail: bool, as_json: bool) -> int:
    """Prints it; 1 when ``fail`` is asked for and an alarm is active."""
    with open_reader(config, database) as reader:
        robot, joints, devices = reader.robot(), _joints(reader), reader.devices()
    if as_json:
        output.print_json({"robot": robot, "joints": [_document(joint) for joint in joints]})
    else:
        _print(robot, joints, devices, datetime.now(UTC))
    return int(fail and any(joint.alarms for joint in joints))


def _joints(reader: Reader) -> list[JointStatus]:
    return [
        JointStatus(joint, reader.last_window(joint.name), reader.active_alarms(joint.name))
        for joint in reader.joints()
    ]


def _document(status: JointStatus) -> dict[str, Any]:
    last = status.last
    return {
        "name": status.joint.name,
        "health": status.joint.health.value,
        "score": last and last.score,
        "level": last and last.level,
        "play": last and last.play,
        "last_window": last and iso(last.time),
        "alarms": [
            {
                "cause": alarm.cause.value,
                "severity": alarm.severity.value,
                "state": alarm.state,
                "raised": iso(alarm.raised),
                "acknowledged": alarm.acknowledged and iso(alarm.acknowledged),
                "reason": alarm.reason,
            }
            for alarm in status.alarms
        ],
    }


def _print(robot: str, joints: list[JointStatus], devices: list[DeviceRow], now: datetime) -> None:
    from rich.markup import escape

    output.print_markup(f"robot [bold]{escape(robot)}[/bold]" + ("" if joints else ": no joint has been seen yet"))
    if joints:
        columns = ("joint", "health", "score", "level", "play", "last window", "why")
        rows = [_row(joint, now) for joint in joints]
        output.print_table(columns, rows, right=("score", "level", "play"))
    for alarm in (alarm for joint in joints for alarm in joint.alarms):
        raised = f"raised {times.local(alarm.raised)} UTC"
        output.print_lines([f"alarm: {alarm.joint}: {alarm.severity.value}: {alarm.reason} ({raised})"])
    output.print_lines([line for device in devices if (line := _complaint(device))])


def _row(status: JointStatus, now: datetime) -> list[str]:
    from rich.markup import escape

    joint, last = status.joint, status.last
    colour = COLOURS[joint.health]
    numbers = ["-", "-", "-", "none yet"]
    if last:
        when = times.ago(last.time, now)
        numbers = [output.number(last.score), f"{last.level:.2f}", output.arcmin(last.play), when]
    return [escape(joint.name), f"[{colour}]{joint.health.value}[/{colour}]", *numbers, escape(joint.reason)]


def _complaint(device: DeviceRow) -> str:
    """What a device has lost, "" when nothing."""
    counts = ("lost", "late", "broken", "silent", "overwritten")
    bad = [f"{getattr(device, name)} {name}" for name in counts if getattr(device, name)]
    if not bad and not device.reason:
        return ""
    told = ", ".join([*bad, f"of {device.samples} samples"]) if bad else ""
    return f"device {device.name}: " + "; ".join(filter(None, [device.state, device.reason, told]))
