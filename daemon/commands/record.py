"""``lostmotion record``: raw measurement of one joint, or of an accelerometer alone, to a recording."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from lostmotion.daemon import config as configuration
from lostmotion.daemon.capture import also_moved_by, head
from lostmotion.daemon.commands.devices import Devices, Event
from lostmotion.daemon.commands.output import counted, print_json
from lostmotion.daemon.config import Config
from lostmotion.drivers.base import AccelBlock, ServoReading
from lostmotion.drivers.errors import IdentityError, LostmotionError
from lostmotion.drivers.recorder import Recorder

__all__ = ["RecordError", "record"]


class RecordError(LostmotionError):
    """The joint to record is ambiguous, or has delivered nothing."""


class Tally:
    """How many samples made it into the recording, by device, and what did not, by kind."""

    def __init__(self) -> None:
        self.samples = {"servo": 0, "accelerometer": 0}
        self.counts = {"lost": 0, "late": 0, "broken": 0, "silent": 0}

    def add_losses(self, data: ServoReading | AccelBlock) -> None:
        """Counts the losses of one reading."""
        for kind in self.counts:
            value = getattr(data, kind, 0)
            self.counts[kind] += value if isinstance(value, int) else len(value)

    def __str__(self) -> str:
        return ", ".join(f"{count} {kind}" for kind, count in self.counts.items() if count)


def record(
    given: Path, duration_s: float, output: Path, joint: str | None, accelerometer: str | None, as_json: bool
) -> None:
    """Measures for ``duration_s`` seconds of robot time from when the devices are identified; Ctrl-C, or a
    device that goes away, leaves what came until then.  ``as_json``: prints what was measured.

    Raises RecordError, ConfigError, DriverError.
    """
    whole = configuration.load(given, joints=accelerometer is None)
    config = _alone(whole, joint) if accelerometer is None else _sensor_alone(whole, accelerometer)
    others = also_moved_by(whole, config.joints[0]) if config.joints else []
    if others:
        advice = "hold it still, as a recording of one joint does not tell whose impacts are in it"
        sys.stderr.write(f"note: {', '.join(others)} also moves {config.accelerometers[0].name}; {advice}\n")
    what = f"joint {config.joints[0].name}" if config.joints else f"accelerometer {accelerometer}"
    devices, tally = Devices(config), Tally()
    with devices:
        for event in devices.identities():
            _check(event)
        start = devices.clock.now()
        recorder = Recorder(output, _metadata(config, devices, others), start)
        try:
            with _progress(duration_s) as advance:
                for event in devices.events(duration_s):
                    _take(event, recorder, tally, start, start + duration_s)
                    advance(min(devices.clock.now() - start, duration_s))
        finally:
            recorder.close()
            tally.counts["late"] += recorder.late
            measured_s = min(devices.clock.now() - start, duration_s)
            sys.stderr.write(f"{output}: {counted(recorder.rows, 'row')} of {what}{_span(recorder, tally)}\n")
    if recorder.rows == 0:
        raise RecordError(f"{output}: found no samples in {duration_s:g} s; try `lostmotion doctor --config {given}`")
    if as_json:
        rates = {device: count / measured_s for device, count in tally.samples.items()}
        names = {"joint": config.joints[0].name} if config.joints else {}
        names["accelerometer"] = config.accelerometers[0].name
        document = {"path": str(output), **names, "rows": recorder.rows, "duration": measured_s}
        print_json(document | {"rates": rates, "losses": tally.counts})


def _span(recorder: Recorder, tally: Tally) -> str:
    """How long a recording is, and what is missing in it."""
    return (f" over {recorder.duration:.4g} s" if recorder.rows else "") + (f" ({tally})" if str(tally) else "")


def _alone(config: Config, asked: str | None) -> Config:
    """The configuration without the other joints and their devices."""
    names = [joint.name for joint in config.joints]
    if asked is None and len(names) > 1:
        raise RecordError(f"found {len(names)} joints, expected one; choose with --joint from {', '.join(names)}")
    joint = config.joint(asked or names[0])
    return replace(config, joints=(joint,), accelerometers=(config.accelerometer(joint.accelerometer),))


def _sensor_alone(config: Config, name: str) -> Config:
    """The configuration with one accelerometer and nothing else: what moves it need not be there yet."""
    there = [sensor.name for sensor in config.accelerometers]
    if name not in there:
        raise RecordError(f"--accelerometer: found {name!r}, expected one of {', '.join(there)}")
    return replace(config, joints=(), accelerometers=(config.accelerometer(name),))


def _metadata(config: Config, devices: Devices, others: list[str]) -> dict[str, Any]:
    (sensor,) = config.accelerometers
    joint = next(iter(config.joints), None)
    limits = {
        key: getattr(device.port, key)
        for device in devices.all
        for key in ("resolution_rad", "range_ms2")
        if hasattr(device.port, key)
    }
    return head(config, sensor, joint, devices.clock.utc(devices.clock.now()), limits, others)


def _check(event: Event) -> None:
    """Raises DriverError for a device that failed, or is not the one expected."""
    if event.error:
        raise event.error
    for identity in event.identities:
        if not identity.ok:
            raise IdentityError(f"{identity.name}: found {identity.found}, expected {identity.expected}")


def _take(event: Event, recorder: Recorder, tally: Tally, start: float, end: float) -> None:
    """Writes what the event brings in start <= robot time [s] < end."""
    _check(event)
    data = event.data
    if isinstance(data, ServoReading):
        samples = [sample for sample in data.samples if start <= sample.time < end]
        recorder.add_servo(samples)
        tally.samples["servo"] += len(samples)
    elif isinstance(data, AccelBlock):
        part = slice(*np.searchsorted(data.time, [start, end], "left"))
        recorder.add_accel(AccelBlock(data.time[part], data.accel[part]))
        tally.samples["accelerometer"] += len(data.time[part])
    if data is not None:
        tally.add_losses(data)


@contextmanager
def _progress(total: float) -> Iterator[Any]:
    """A bar on stderr, on a terminal only; gives a function of the seconds done."""
    if not sys.stderr.isatty() or math.isinf(total):
        yield lambda done: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (TextColumn("recording"), BarColumn(), TextColumn("{task.completed:.1f} s"), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task("recording", total=total)
        yield lambda done: progress.update(task, completed=done)
