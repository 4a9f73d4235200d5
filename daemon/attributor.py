"""Which joint the play comes from, while a service runs: windows of the joints that share accelerometers.

``detector/attribution.py`` computes the evidence of a window; ``alarm.py`` uses the result.  No clock, no I/O.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from lostmotion.daemon.records import SURE, Origin
from lostmotion.daemon.ring import Ring
from lostmotion.detector.attribution import Evidence, Mover, attribute, evidence
from lostmotion.detector.commanded import BEFORE_S, smoothed
from lostmotion.detector.window import DetectorSettings, FloatArray, Window
from lostmotion.detector.windows import cut

__all__ = ["Attributor", "CommandHistory", "SharedSensor"]

WINDOWS = 100
"""the last so many windows count"""
PACE_S = 20.0
"""once so many are known, the next one is evaluated so long after the last [s]. Wear takes months, and the last
hundred then span half an hour of motion.  With 5 s six joints that reverse all the time took a tenth of the main
thread.  After half an hour of motion of two joints, play of the second one is certain after 7 to 37 min in 20 trials
each (medians of four arms: 7 to 24), an exchange after 10 to 43 (17 to 32), a repair after 23 to 29 (24 to 28)"""
GIVE_UP_S = 1.0
"""how long after its end a window waits for late samples [s]"""
DOUBT = 0.04
"""what an earlier run found is believed no more than to this"""


@dataclass(frozen=True, slots=True)
class SharedSensor:
    """An accelerometer that several joints move: its rate, its bar, and their lever arms [m]."""

    accelerometer: str
    rate_hz: float
    settings: DetectorSettings
    levers: Mapping[str, float]


class CommandHistory(Protocol):
    """A joint's last commands: times [s] and angles [rad], shape (2, M); newest: the time of the newest sample [s]."""

    @property
    def newest(self) -> float: ...

    @property
    def commands(self) -> FloatArray: ...


class Attributor:
    """Joints that share accelerometers, directly or by way of others."""

    def __init__(self, sensors: Sequence[SharedSensor]) -> None:
        self.joints = tuple(sorted({joint for sensor in sensors for joint in sensor.levers}))
        self.accelerometers = tuple(sensor.accelerometer for sensor in sensors)
        self._sensors = sensors
        self._prior = [0.5] * len(self.joints)
        self._evidence: deque[Evidence] = deque(maxlen=WINDOWS)
        self._waiting: deque[Window] = deque()
        self._weighed = -math.inf  # start of the last window that was, or is going to be [s]
        self.origin = Origin(dict.fromkeys(self.joints, 0.5), 0)

    def resume(self, earlier: Iterable[Origin]) -> None:
        """Begins with the result of an earlier run for the same joints."""
        for origin in earlier:
            if tuple(sorted(origin.probabilities)) == self.joints:
                self._prior = [min(max(origin.probabilities[joint], DOUBT), 1 - DOUBT) for joint in self.joints]
                self._pool()

    def continue_from(self, earlier: Attributor) -> None:
        """Goes on with the windows of an earlier one of the same joints and sensors, whose clock has not begun anew."""
        self._prior, self._evidence, self._weighed = earlier._prior, earlier._evidence, earlier._weighed
        self.origin = earlier.origin

    def add_window(self, window: Window) -> None:
        """A window of one of these joints has been scored."""
        if len(self._evidence) < WINDOWS or window.start >= self._weighed + PACE_S:
            self._waiting.append(window)
            self._weighed = window.start

    def step(self, rings: Mapping[str, Ring], histories: Mapping[str, CommandHistory]) -> None:
        """Takes the windows for which everything is there, and gives up those for which it does not come."""
        if not self._waiting:
            return
        sensors, joints = [rings[name] for name in self.accelerometers], [histories[joint] for joint in self.joints]
        fresh = False
        while self._waiting:
            window = self._waiting[0]
            end = window.start + window.duration
            there = min(*(ring.newest for ring in sensors), *(joint.newest for joint in joints)) >= end
            if not there and max(ring.newest for ring in sensors) < end + GIVE_UP_S:
                break
            self._waiting.popleft()
            found = self._weigh(window, sensors, joints) if there else None
            if found is not None:
                self._evidence.append(found)
                fresh = True
        if fresh:
            self._pool()

    def _weigh(self, window: Window, rings: Sequence[Ring], joints: Sequence[CommandHistory]) -> Evidence | None:
        start, length = window.start - BEFORE_S, window.duration + BEFORE_S
        segments = []
        for sensor, ring in zip(self._sensors, rings, strict=True):
            times, accel = ring.slice(start - 1 / sensor.rate_hz, start + length + 1 / sensor.rate_hz)
            segments.append(cut("", times, accel, start, length, sensor.rate_hz))
        movers = []
        for name, joint in zip(self.joints, joints, strict=True):
            times, angles = joint.commands
            movers.append(Mover(times, angles, tuple(sensor.levers.get(name, 0.0) for sensor in self._sensors)))
        since = max(window.start, self._evidence[-1].until) if self._evidence else window.start
        return evidence(segments, movers, [sensor.settings for sensor in self._sensors], since)

    def is_sure(self, joint: str) -> bool:
        """Whether the play is known to be this joint's."""
        return self.origin.probabilities[joint] >= SURE

    def alone(self, segment: Window, accelerometer: str, histories: Mapping[str, CommandHistory]) -> Window | None:
        """The segment as if its joint had moved alone: minus the quasi-static acceleration from the other joints'
        commands.  None where these have too few samples."""
        sensor = next(sensor for sensor in self._sensors if sensor.accelerometer == accelerometer)
        accel = segment.accel.copy()
        for name in sensor.levers.keys() - {segment.joint}:
            times, angles = histories[name].commands
            command = smoothed(times, angles, segment)
            if command is None:
                return None
            accel -= sensor.levers[name] * command.acceleration(np.minimum(segment.time - segment.time[0], command.end))
        return replace(segment, accel=accel)

    def _pool(self) -> None:
        pooled = attribute(self._evidence, self._prior)
        probabilities = zip(self.joints, pooled.joints.tolist(), strict=True)
        self.origin = Origin(dict(probabilities), pooled.windows)
