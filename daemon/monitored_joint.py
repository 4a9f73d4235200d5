"""One joint while the service runs: its reversals, the windows that wait, its commands, and what was learnt of it."""

from __future__ import annotations

import heapq
import math
from array import array
from bisect import bisect_left
from collections import Counter
from dataclasses import dataclass, field, replace

import numpy as np

from lostmotion.detector.flank import law_of
from lostmotion.detector.learner import BarLooks, Learner, is_learning
from lostmotion.detector.play_size import SizeLaw
from lostmotion.detector.servo import UNKNOWN
from lostmotion.detector.trigger import Trigger
from lostmotion.detector.window import DetectorSettings, FloatArray
from lostmotion.detector.windows import window_length
from lostmotion.drivers.base import ServoSample

__all__ = ["Counts", "JointPlan", "MonitoredJoint", "PendingWindow"]

COMMANDS_S = 4.0
"""commands are kept for so long before the newest one, or before a window that waits: for the size of the play [s]"""
COMMANDED_S = 0.5
"""so much of the commanded motion before a window is kept with it: the reversal and what led to it [s]"""


@dataclass(frozen=True, slots=True)
class JointPlan:
    """How one joint is monitored: its accelerometer, that one's rate, and the rate of the joint's commands [Hz]."""

    joint: str
    accelerometer: str
    rate_hz: float
    poll_hz: float
    settings: DetectorSettings


@dataclass(slots=True)
class Counts:
    """Windows of one joint: opened, scored, and lost by reason."""

    triggered: int = 0
    scored: int = 0
    lost: Counter[str] = field(default_factory=Counter)


@dataclass(frozen=True, slots=True, order=True)
class PendingWindow:
    """A window that waits for its acceleration."""

    end: float
    start: float
    excitation: float
    temperature: float


class MonitoredJoint:
    """What is known of one joint while it runs; looks: at the bar of its accelerometer, those of all its joints."""

    def __init__(self, plan: JointPlan, looks: BarLooks) -> None:
        self.plan = plan
        self.length = window_length(plan.settings, plan.rate_hz)
        self.trigger: Trigger | None = None
        self.pending: list[PendingWindow] = []
        self.newest = -math.inf
        self.temperature = math.nan
        self.law, self.law_windows, self.servo, self.size_law = law_of(plan.settings), 0, UNKNOWN, SizeLaw()
        self._times, self._angles = array("d"), array("d")
        self.counts = Counts()
        count = round(self.length * plan.rate_hz)
        self.learner = Learner(plan.settings, plan.rate_hz, count, looks) if is_learning(plan.settings) else None

    @property
    def settings(self) -> DetectorSettings:
        """Those of the plan, with noise and bar as they are known by now."""
        return self.learner.settings if self.learner else self.plan.settings

    @property
    def bar_settings(self) -> DetectorSettings:
        """Those of the plan, with the bar as it is known by now."""
        given, known = self.plan.settings, self.settings
        if (given.f_res_hz, given.zeta) == (known.f_res_hz, known.zeta):
            return given
        return replace(given, f_res_hz=known.f_res_hz, zeta=known.zeta)

    def take(self, samples: list[ServoSample], resolution_rad: float, since: float) -> None:
        """Opens a window for every reversal in these samples' commands at or after ``since``."""
        if self.trigger is None:
            self.trigger = Trigger(self.plan.settings, self.plan.poll_hz, resolution_rad)
        last = samples[-1]
        self.newest = max(self.newest, last.time)
        if math.isfinite(last.temperature):
            self.temperature = last.temperature
        times, angles = [sample.time for sample in samples], [sample.command for sample in samples]
        self._times.extend(times)
        self._angles.extend(angles)
        for reversal in self.trigger.push(times, angles):
            if reversal.time < since:
                continue
            self.counts.triggered += 1
            window = PendingWindow(reversal.time + self.length, reversal.time, abs(reversal.swing), self.temperature)
            heapq.heappush(self.pending, window)
        waiting = self.pending[0].start if self.pending else math.inf
        gone = bisect_left(self._times, min(self.newest, waiting) - COMMANDS_S)
        del self._times[:gone], self._angles[:gone]

    @property
    def commands(self) -> FloatArray:
        """The last ones: times [s] and angles [rad], shape (2, M)."""
        return np.array((self._times, self._angles))

    def commanded(self, window: PendingWindow) -> FloatArray:
        """Those from shortly before a window to its end."""
        first = bisect_left(self._times, window.start - COMMANDED_S)
        last = bisect_left(self._times, window.end)
        return np.array((self._times[first:last], self._angles[first:last]))
