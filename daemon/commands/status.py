"""``lostmotion status``: the joints, their health, and active alarms."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from lostmotion.daemon import documents
from lostmotion.daemon.commands import output, times
from lostmotion.daemon.commands.reasons import present_reason
from lostmotion.daemon.commands.where import find_database, open_reader
from lostmotion.daemon.database import is_held
from lostmotion.daemon.learnt import NoiseRow
from lostmotion.daemon.reader import Reader
from lostmotion.daemon.records import AlarmRow, AlarmState, DeviceRow, Health, JointRow, Origin, ScoreRow

__all__ = ["status"]

COLOURS = {Health.OK: "green", Health.DEGRADED: "yellow", Health.WARNING: "dark_orange", Health.ERROR: "red"}


@dataclass(frozen=True, slots=True)
class JointStatus:
    """One joint as the database has it; alarms: all that are not normal; why: the present reason for its health."""

    joint: JointRow
    last: ScoreRow | None
    alarms: list[AlarmRow]
    why: str

    @property
    def active(self) -> list[AlarmRow]:
        return [alarm for alarm in self.alarms if alarm.is_active]


def status(config: Path | None, database: Path | None, fail: bool, as_json: bool) -> int:
    """Prints it; 1 when ``fail`` is asked for and an alarm is active."""
    with open_reader(config, database) as reader:
        robot, joints, devices, origins = reader.robot(), _joints(reader), reader.devices(), reader.origins()
        noises, flanks = reader.noises(), reader.flanks()
    is_watched = is_held(find_database(config, database)) is not False
    if as_json:
        documented = [documents.joint(joint.joint, joint.last, joint.active) for joint in joints]
        output.print_json(
            {"robot": robot, "joints": documented} | documents.attribution(origins) | documents.learnt(noises, flanks)
        )
    else:
        _print(robot, joints, devices, origins, datetime.now(UTC))
        output.print_lines([line for row in noises for line in _learnt(row)])
        output.print_lines([f"{row.joint}: {row}" for row in flanks])
        output.print_lines([] if is_watched else ["no service is running: this is the state that the last one left"])
    return int(fail and any(joint.active for joint in joints))


def _joints(reader: Reader) -> list[JointStatus]:
    return [_joint(reader, joint) for joint in reader.joints()]


def _joint(reader: Reader, joint: JointRow) -> JointStatus:
    alarms = reader.alarms(joint.name, living=True)
    return JointStatus(joint, reader.last_window(joint.name), alarms, present_reason(reader, joint, alarms))


def _print(
    robot: str, joints: list[JointStatus], devices: list[DeviceRow], origins: list[Origin], now: datetime
) -> None:
    from rich.markup import escape

    output.print_markup(f"robot [bold]{escape(robot)}[/bold]" + ("" if joints else ": no joint has been seen yet"))
    if joints:
        columns = ("joint", "health", "score", "level", "play", "severity", "last window", "why")
        rows = [_row(joint, now) for joint in joints]
        output.print_table(columns, rows, right=("score", "level", "play", "severity"))
    for alarm in (alarm for joint in joints for alarm in joint.alarms):
        output.print_lines([_alarm(alarm)])
    output.print_lines([f"play: {origin}, after {origin.windows} windows" for origin in origins])
    output.print_lines([line for device in devices if (line := _complaint(device))])


def _alarm(alarm: AlarmRow) -> str:
    notes = [f"raised {times.local(alarm.raised)} UTC"]
    if alarm.shelved_until:
        notes.append(f"shelved until {times.local(alarm.shelved_until)} UTC")
    elif alarm.state is not AlarmState.ACTIVE:
        notes.append("returned to normal, not acknowledged" if alarm.cleared else "acknowledged")
    return f"alarm: {alarm.joint}: {alarm.severity.value}: {alarm.reason} ({', '.join(notes)})"


def _row(status: JointStatus, now: datetime) -> list[str]:
    from rich.markup import escape

    joint, last = status.joint, status.last
    colour = COLOURS[joint.health]
    numbers = ["-", "-", "-", "-", "none yet"]
    if last:
        when = times.ago(last.time, now)
        numbers = [
            output.number(last.score),
            f"{last.level:.2f}",
            output.arcmin(last.play),
            output.arcmin(last.severity),
            when,
        ]
    return [escape(joint.name), f"[{colour}]{joint.health.value}[/{colour}]", *numbers, escape(status.why)]


def _learnt(row: NoiseRow) -> list[str]:
    """Noise and bar of a joint, and how they last changed since they were first learnt."""
    lines = [f"{row.joint}: {row.resonance}"]
    if row.covariance:
        lines.insert(0, f"{row.joint}: noise {row.deviation:.3g} m/s², learnt from {row.seen} windows")
    if len(row.changes) > 1:
        last = row.changes[-1]
        cause = "another tool, a fan, a loose sensor or bar?"
        lines.append(f"{row.joint}: {last.text} ({times.local(last.time)} UTC): {cause}")
    return lines


def _complaint(device: DeviceRow) -> str:
    """What a device has lost, "" when nothing."""
    counts = ("lost", "late", "broken", "silent", "overwritten")
    bad = [f"{getattr(device, name)} {name}" for name in counts if getattr(device, name)]
    if not bad and not device.reason:
        return ""
    losses = ", ".join([*bad, f"of {device.samples} samples"]) if bad else ""
    return f"device {device.name}: " + "; ".join(filter(None, [device.state, device.reason, losses]))
