"""A recording as a robot: its rows are returned as if they were being measured.

``port`` is the recording's path, relative to the working folder of the process; ``column`` selects which of its columns
is the joint's command, or the accelerometer's signal (any column may be the one that rings).  ``recording.py``
reads the file.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from operator import attrgetter
from typing import Annotated, Literal

import msgspec
import numpy as np
from numpy.typing import NDArray

from lostmotion.drivers.base import (
    AccelBlock,
    AccelerometerOptions,
    Driver,
    FloatArray,
    Identity,
    JointOptions,
    RobotOptions,
    ServoReading,
    ServoSample,
)
from lostmotion.drivers.clock import Clock, VirtualClock
from lostmotion.drivers.errors import EndOfData, PortError
from lostmotion.drivers.pacing import Pace, as_utc
from lostmotion.drivers.recording import Recording, read_recording

__all__ = ["DRIVER", "ReplayAccelerometer", "ReplayClock", "ReplayJoints"]

log = logging.getLogger(__name__)

Column = Literal["command", "position", "accel", "torque", "force", "displacement", "voltage", "current", "temperature"]
SERVO_FIELDS = ("position", "torque", "current", "voltage", "temperature")
RATE_TOLERANCE = 0.05
LEAST_RATE = 0.5


class ReplayJointOptions(JointOptions, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """port: the recording; column: which of its columns is the command.

    A recording faster than poll_hz is thinned to it, as polling would have done.
    """

    column: Column = "command"


class ReplayAccelerometerOptions(AccelerometerOptions, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """port: the recording; column: which of its columns is the signal that rings."""

    column: Column = "accel"


class ReplayOptions(RobotOptions, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """speed: 1 is real time, "max" as fast as the samples are taken.

    start: UTC of the first row; by default the recording's ``start``, else such that it ends now.
    """

    speed: Annotated[float, msgspec.Meta(gt=0)] | Literal["max"] = 1.0
    start: datetime | None = None


class ReplayClock(VirtualClock):
    """The time of a replay, 0 at the recording's first row, and the recordings that its joints and sensors share."""

    def __init__(self, robot: RobotOptions) -> None:
        assert isinstance(robot, ReplayOptions)
        super().__init__(as_utc(robot.start) if robot.start else datetime.now(UTC))
        self.pace = Pace(float("inf") if robot.speed == "max" else robot.speed)
        self._start_is_known = robot.start is not None
        self._recordings: dict[str, Recording] = {}
        self._loading = threading.Lock()

    def recording(self, path: str) -> Recording:
        """The recording at ``path``, read once.  Raises RecordingError."""
        with self._loading:
            if path not in self._recordings:
                self._recordings[path] = read_recording(path)
                self._take_start(self._recordings[path])
            return self._recordings[path]

    def _take_start(self, recording: Recording) -> None:
        """Takes the recording's start in UTC, unless another is known, and logs what is odd about the file."""
        if not self._start_is_known:
            self._start = recording.start or datetime.now(UTC) - timedelta(seconds=recording.duration)
            self._start_is_known = True
        if recording.truncated:
            log.warning("%s: the last line is cut off and left out", recording.name)
        for column, unit in recording.foreign_units.items():
            log.info("%s: the column %s is in %s", recording.name, column, unit)


class Track:
    """Where the reading of one device has got to, kept in time with the clock."""

    def __init__(self, times: FloatArray, clock: ReplayClock) -> None:
        self._times = times
        self._clock = clock
        self._until = 0.0

    def advance(self) -> tuple[float, float]:
        """Waits for the next step of time; its begin and end [s], which may be the same.  Raises EndOfData."""
        begin = self._until
        following = int(np.searchsorted(self._times, begin, "left"))
        if following == len(self._times):
            raise EndOfData
        pace = self._clock.pace
        if pace.speed == float("inf"):
            begin = float(self._times[following])  # nobody wants to wait for a gap to pass
        if not pace.wait(begin + pace.step):
            return begin, begin
        self._until = begin + pace.step
        self._clock.advance(min(self._until, float(self._times[-1])))
        return begin, self._until


class ReplayJoints:
    """The joints of one recording."""

    def __init__(self, joints: Sequence[JointOptions], robot: RobotOptions, clock: Clock) -> None:
        assert isinstance(clock, ReplayClock)
        self.resolution_rad = float("nan")
        self._joints = [joint for joint in joints if isinstance(joint, ReplayJointOptions)]
        self._clock = clock
        self._samples: dict[str, tuple[FloatArray, dict[str, FloatArray]]] = {}
        self._track: Track | None = None

    def open(self) -> None:
        """Reads the recording, if no other device has yet; a second time it goes on where it was."""
        if self._track is None:
            self._samples = {joint.name: self._load(joint) for joint in self._joints}
            if all(joint.column == "command" for joint in self._joints):
                recording = self._clock.recording(self._joints[0].port)
                self.resolution_rad = recording.number("resolution_rad", float("nan"))
            self._track = Track(np.sort(np.concatenate([times for times, _ in self._samples.values()])), self._clock)

    def identify(self) -> tuple[Identity, ...]:
        """The rate of the recording against that of the polls; a faster one will do, a slow one looks like gaps."""
        found = []
        for joint in self._joints:
            recording = self._clock.recording(joint.port)
            too_slow = _rate_hz(recording.signal(joint.column)[0]) < LEAST_RATE * joint.poll_hz
            expected = f"{joint.column} at {joint.poll_hz:g} Hz or more"
            found.append(Identity(joint.name, _describe(recording, joint.column), expected, not too_slow))
        return tuple(found)

    def read(self) -> ServoReading:
        if self._track is None:
            raise PortError(f"{self._joints[0].port}: found it closed, expected it open; call open first")
        begin, end = self._track.advance()
        samples = [
            ServoSample(name, float(times[i]), **{column: float(values[i]) for column, values in columns.items()})
            for name, (times, columns) in self._samples.items()
            for i in range(*np.searchsorted(times, [begin, end], "left"))
        ]
        return ServoReading(tuple(sorted(samples, key=attrgetter("time"))))

    def close(self) -> None:
        """Nothing is held open."""

    def _load(self, joint: ReplayJointOptions) -> tuple[FloatArray, dict[str, FloatArray]]:
        """Robot times [s] of the joint's samples, and the fields of ServoSample that the recording has."""
        recording = self._clock.recording(joint.port)
        recording.signal(joint.column)
        columns = {"command": recording.columns[joint.column], "position": np.full(len(recording.time), np.nan)}
        columns |= {name: recording.columns[name] for name in SERVO_FIELDS if name in recording.columns}
        rows = np.flatnonzero(~np.isnan(columns["command"]))
        rows = rows[_polled(recording.time[rows] - recording.time[0], joint.poll_hz)]
        return recording.time[rows] - recording.time[0], {name: values[rows] for name, values in columns.items()}


class ReplayAccelerometer:
    """One column of a recording as the signal of an accelerometer."""

    def __init__(self, options: AccelerometerOptions, robot: RobotOptions, clock: Clock) -> None:
        assert isinstance(options, ReplayAccelerometerOptions)
        assert isinstance(clock, ReplayClock)
        self.range_ms2 = float("inf")
        self._options = options
        self._clock = clock
        self._times = self._values = np.empty(0)
        self._track: Track | None = None

    def open(self) -> None:
        """Reads the recording, if no other device has yet; a second time it goes on where it was."""
        if self._track is None:
            recording = self._clock.recording(self._options.port)
            times, self._values = recording.signal(self._options.column)
            if self._options.column == "accel":
                self.range_ms2 = recording.number("range_ms2", float("inf"))
            self._times = times - recording.time[0]
            self._track = Track(self._times, self._clock)

    def identify(self) -> tuple[Identity, ...]:
        """The rate of the recording against the configured one."""
        options = self._options
        recording = self._clock.recording(options.port)
        rate = _rate_hz(recording.signal(options.column)[0])
        ok = abs(rate / options.rate_hz - 1) <= RATE_TOLERANCE
        expected = f"{options.column} at {options.rate_hz:g} Hz"
        return (Identity(options.name, _describe(recording, options.column), expected, ok),)

    def read(self) -> AccelBlock:
        if self._track is None:
            raise PortError(f"{self._options.port}: found it closed, expected it open; call open first")
        part = slice(*np.searchsorted(self._times, self._track.advance(), "left"))
        return AccelBlock(self._times[part], self._values[part])

    def close(self) -> None:
        """Nothing is held open."""


def _describe(recording: Recording, column: str) -> str:
    times, _ = recording.signal(column)
    return f"{column} at {_rate_hz(times):.4g} Hz, {recording.duration:.4g} s, in {recording.name}"


def _rate_hz(times: FloatArray) -> float:
    """The usual rate of samples [Hz], NaN for a single one."""
    return 1 / float(np.median(np.diff(times))) if len(times) > 1 else float("nan")


def _polled(times: FloatArray, poll_hz: float) -> NDArray[np.intp]:
    """Which samples a poll at ``poll_hz`` would have met: all where they are not much faster, else the first in each
    period."""
    if not _rate_hz(times) > 1.5 * poll_hz:
        return np.arange(len(times))
    return np.unique(np.floor(times * poll_hz + 1e-6), return_index=True)[1]  # 0.58 s x 50 Hz is 28.999…


DRIVER = Driver(
    name="replay",
    summary="a recording as a robot, at real speed or as fast as possible",
    servo=ReplayJoints,
    accelerometer=ReplayAccelerometer,
    joint_options=ReplayJointOptions,
    accelerometer_options=ReplayAccelerometerOptions,
    robot_options=ReplayOptions,
    clock=ReplayClock,
)
