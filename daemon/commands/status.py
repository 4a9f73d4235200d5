"""``lostmotion status``: the joints, their health, and active alarms."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from lostmotion.daemon import documents, times
from lostmotion.daemon.commands import output
from lostmotion.daemon.commands.reasons import present_reason
from lostmotion.daemon.commands.where import find_config, find_database, open_reader
from lostmotion.daemon.database import is_full, is_held
from lostmotion.daemon.learnt import NoiseRow
from lostmotion.daemon.reader import Reader
from lostmotion.daemon.records import AlarmRow, AlarmState, DeviceRow, Health, JointRow, ScoreRow, SinkRow, from_micros
from lostmotion.daemon.timekeeper import STEP_S, ClockRow

__all__ = ["status"]

COLOURS = {Health.OK: "green", Health.DEGRADED: "yellow", Health.WARNING: "dark_orange", Health.ERROR: "red"}


@dataclass(frozen=True, slots=True)
class JointStatus:
    """One joint as the database has it; alarms: all that are not normal; why: the present reason for its health."""

    joint: JointRow
    last: ScoreRow | None
    alarms: list[AlarmRow]
    why: str


def status(config: Path | None, database: Path | None, fail: bool, as_json: bool) -> int:
    """Prints it; 1 when ``fail`` is asked for and an alarm is active."""
    with open_reader(config, database) as reader:
        if as_json:
            output.print_json(documents.status(reader))
        else:
            _print(reader, _windows(config, database))
        is_bad, clock = bool(reader.active_alarms()), reader.clock()
    if not as_json:
        output.print_lines(_about(find_database(config, database), clock))
    return int(fail and is_bad)


def _about(database: Path, clock: ClockRow | None) -> list[str]:
    """What makes the state that the database has an old one, or its times others than this computer's."""
    if is_held(database) is False:
        return ["no service is running: this is the state that the last one left"]
    if is_full(database.resolve().parent):
        return [f"the disk of {database} is full: what the service has measured since then waits in its memory"]
    if clock is None:  # a virtual robot's
        return []
    known = from_micros(clock.known_us)
    behind_s = (datetime.now(UTC) - known).total_seconds()
    if abs(behind_s) <= STEP_S:
        return []
    how_far = f"{times.span(abs(behind_s))} {'behind' if behind_s > 0 else 'ahead of'}"
    why = "the clock has stepped, or the service no longer writes; its log tells which"
    return [f"the service's time is {times.local(known)} UTC, {how_far} this computer's clock: {why}"]


def _windows(config: Path | None, database: Path | None) -> int:
    """How many windows count for an alarm, as the configuration of the robot says; 0 where that is not known."""
    return find_config(config).alarm.windows if config is not None or database is None else 0


def _joint(reader: Reader, joint: JointRow, windows: int) -> JointStatus:
    alarms = reader.alarms(joint.name, living=True)
    return JointStatus(joint, reader.last_window(joint.name), alarms, present_reason(reader, joint, alarms, windows))


def _print(reader: Reader, windows: int) -> None:
    from rich.markup import escape

    robot, now = reader.robot(), datetime.now(UTC)
    joints = [_joint(reader, joint, windows) for joint in reader.joints()]
    output.print_markup(f"robot [bold]{escape(robot)}[/bold]" + ("" if joints else ": no joint has been seen yet"))
    if joints:
        columns = ("joint", "health", "score", "level", "play", "severity", "last window", "why")
        rows = [_row(joint, now) for joint in joints]
        output.print_table(columns, rows, right=("score", "level", "play", "severity"))
    output.print_lines([_alarm(alarm) for joint in joints for alarm in joint.alarms])
    output.print_lines(
        [f"play: {origin}, after {output.counted(origin.windows, 'window')}" for origin in reader.origins()]
    )
    output.print_lines([line for device in reader.devices() if (line := _complaint(device))])
    output.print_lines([_sink(sink, now) for sink in reader.sinks()])
    output.print_lines([line for row in reader.noises() for line in _learnt(row)])
    output.print_lines([f"{row.joint}: {row}" for row in reader.flanks()])


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


def _sink(sink: SinkRow, now: datetime) -> str:
    """Whether it is up, since when, and why not, or why it was not before."""
    if sink.is_up is None:
        return f"sink {sink.name}: its state is unknown"
    how_long = times.span(abs((now - sink.since).total_seconds()))
    if not sink.is_up:
        return f"sink {sink.name}: down for {how_long}: {sink.error}"
    return f"sink {sink.name}: up for {how_long}" + f"; last error: {sink.error}" * bool(sink.error)


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
    losses = f"{', '.join(bad)}; {device.samples} samples read" if bad else ""  # the lost ones are not among these
    return f"device {device.name}: " + "; ".join(filter(None, [device.state, device.reason, losses]))
