"""The trigger of windows: reversals of the commanded acceleration in a stream of angles of one joint.

Streaming: the result does not depend on how the stream is divided into pushes, and time is that of the samples.  No
windows and no accelerometer here.  docs/decisions/0003-trigger.md has the measurements of the constants.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence

from lostmotion.detector.errors import DetectorError
from lostmotion.detector.jump import JumpDetector
from lostmotion.detector.local_fit import Curvature, LocalFit
from lostmotion.detector.noise import NoiseLevel
from lostmotion.detector.window import DetectorSettings, FloatArray, Reversal

__all__ = ["Trigger"]

INNER_RATE_HZ = 100.0
"""Faster streams are decimated to about this rate: arms and hands do not move faster."""
SPAN = 0.2
"""Length of the parabola [s]."""
LEAST_SAMPLES = 8
"""Least length of the parabola in sample periods, for slow streams."""
GAP_PERIODS = 5
"""After a gap of more sample periods than this the trigger starts again."""
NOISE_FACTOR = 5.0
"""Threshold in standard deviations of the acceleration."""
STEP_FACTOR = 6.0
"""Threshold in quantisation steps / span²; a single step gives a parabola of up to 5.77 of these."""
REST_STEPS = 2.5
"""While the angle stays within so many quantisation steps the joint is at rest: ±1 step of jitter is 2."""
UNKNOWN_STEP = math.radians(0.5)
"""The assumed quantisation before the first motion [rad]."""
TINY = 1e-6
"""Angles closer than this are the same [rad]."""
SUDDEN = 0.2
"""Share of a span in which a sudden acceleration climbs to the threshold; a swaying arm takes longer."""
EARLY = 0.25
"""Time in spans by which the threshold is passed before a sudden acceleration begins."""
JUMP_FACTOR = 6.0
"""Least jump of the goal in standard deviations of its noise."""
JUMP_SWING = 11.5
"""Swing of the parabola's acceleration as it passes over a unit jump, times span²: from +5.77 to -5.77."""


class Trigger:
    """Finds the reversals in the commanded angle of one joint.

    The acceleration is that of a parabola through the last ``SPAN`` seconds.  It has a direction when it exceeds a
    threshold made of the quantisation, of the noise seen so far and of ``settings.min_acceleration``; a reversal is a
    change of direction, at the last zero crossing in between.  A goal that jumps and is then constant (a host that
    writes goals seldom) is one reversal, at the jump, signed as the jump.

    rate_hz: nominal rate of the samples; resolution_rad: their quantisation [rad], 0 if there is none, NaN if unknown
    (then the smallest step seen so far).  ``dropped`` counts samples that could not be used: repeated or out-of-order
    times, NaN.  Raises DetectorError when rate_hz is not positive.
    """

    def __init__(self, settings: DetectorSettings, rate_hz: float, resolution_rad: float) -> None:
        if not 0 < rate_hz < math.inf:
            raise DetectorError(f"the rate of the commands is {rate_hz:g} Hz; expected a positive number (poll_hz)")
        self.dropped = 0
        self._block = 2 * round((rate_hz / INNER_RATE_HZ - 1) / 2) + 1 if rate_hz > INNER_RATE_HZ else 1
        self._longest = GAP_PERIODS / rate_hz
        self._times: list[float] = []
        self._commands: list[float] = []
        self._last_time = -math.inf
        self._last_command = math.nan
        self._learning = math.isnan(resolution_rad)
        self._step = UNKNOWN_STEP if self._learning else max(resolution_rad, TINY)
        self._least = settings.min_acceleration or 0.0
        self._fit = LocalFit(max(SPAN, LEAST_SAMPLES / rate_hz))
        self._noise = NoiseLevel()
        self._jump = JumpDetector(self._fit)
        self._forget()

    def push(self, times: Sequence[float] | FloatArray, commands: Sequence[float] | FloatArray) -> list[Reversal]:
        """The reversals that became certain with these samples: times [s] and angles [rad], equally many of both."""
        found = []
        for time, command in zip(_plain(times), _plain(commands), strict=True):
            # The condition is also false for NaN.
            if not (self._last_time < time < math.inf and abs(command) < math.inf):
                self.dropped += 1
                continue
            reversal = self._thin(time, command)
            if reversal is not None:
                found.append(reversal)
        return found

    def _thin(self, time: float, command: float) -> Reversal | None:
        """Collects samples into blocks and passes on the median of each: a median keeps jumps sharp."""
        if time - self._last_time > self._longest:
            self._forget()
        if self._learning:
            change = abs(command - self._last_command)
            if TINY < change < self._step:
                self._step = change
        self._last_time, self._last_command = time, command
        if self._block == 1:
            return self._take(time, command, time)
        self._times.append(time)
        self._commands.append(command)
        if len(self._times) < self._block:
            return None
        middle = self._block // 2
        reversal = self._take(self._times[middle], sorted(self._commands)[middle], time)
        self._times.clear()
        self._commands.clear()
        return reversal

    def _take(self, time: float, command: float, now: float) -> Reversal | None:
        step, fit, jump, noise = self._step, self._fit, self._jump, self._noise
        noise.add(time, command, step)
        jumped = jump.add(time, command, max(REST_STEPS * step, JUMP_FACTOR * noise.level))
        if jumped is not None:
            at, change = jumped
            self._forget()
            return Reversal(at, now, JUMP_SWING * change / fit.span**2)
        curvature = fit.add(time, command)
        if curvature is None:
            return None
        self._lobes.add(curvature)
        _, accel, gain = curvature
        if abs(accel) < self._threshold(gain):
            return None
        if jump.pending or not fit.moves(REST_STEPS * step):
            return None
        changed = self._lobes.enter(curvature)
        return None if changed is None else Reversal(changed[0], now, changed[1])

    def _threshold(self, gain: float) -> float:
        steps = STEP_FACTOR * self._step / self._fit.span**2
        return max(steps + NOISE_FACTOR * self._noise.level * gain, self._least)

    def _forget(self) -> None:
        """Starts again; the estimates of noise and steps are kept."""
        self._times.clear()
        self._commands.clear()
        self._fit.clear()
        self._noise.interrupt()
        self._jump.clear()
        self._lobes = _Lobes(self._fit.span)


class _Lobes:
    """The acceleration as a sequence of lobes, alternately positive and negative, with weak segments between them."""

    def __init__(self, span: float) -> None:
        self._span = span
        self._direction = 0.0
        self._extreme = 0.0
        self._crossing = math.nan
        self._strong = math.nan
        self._recent: deque[Curvature] = deque(maxlen=4)

    def add(self, curvature: Curvature) -> None:
        """Takes every acceleration, strong or weak, and keeps the last zero crossing."""
        recent = self._recent
        if recent and (recent[-1][1] > 0) != (curvature[1] > 0):
            self._crossing = _zero(recent[-1], curvature)
        recent.append(curvature)

    def enter(self, curvature: Curvature) -> tuple[float, float] | None:
        """Takes a strong acceleration after ``add``; time and swing of the reversal if it begins a new lobe."""
        time, accel, _ = curvature
        old, since, extreme = self._direction, self._strong, self._extreme
        self._direction, self._strong = math.copysign(1.0, accel), time
        if old == self._direction:
            if abs(accel) > abs(extreme):
                self._extreme = accel
            return None
        self._extreme = accel
        if not old:
            return None
        sudden = time - since > self._span and time - _zero(self._recent[0], curvature) < SUDDEN * self._span
        return (time + EARLY * self._span if sudden else self._crossing), accel - extreme


def _zero(one: Curvature, other: Curvature) -> float:
    """Where the line through two accelerations is zero [s]."""
    (before, accel, _), (after, changed, _) = one, other
    if accel == changed:
        return after
    return before + accel / (accel - changed) * (after - before)


def _plain(values: Sequence[float] | FloatArray) -> Sequence[float]:
    """Plain floats: arithmetic on NumPy's scalars is several times slower."""
    return values if isinstance(values, list | tuple) else [float(value) for value in values]
