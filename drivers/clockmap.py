"""A sensor's clock → the host's: a running regression over the times at which its samples arrived.  Pure: time comes in
as an argument.  ``timeline.py`` handles gaps in the sensor's times.
"""

from __future__ import annotations

from collections import deque

import numpy as np

from lostmotion.drivers.base import FloatArray

__all__ = ["ClockMap"]

STRETCH_S = 0.5
"""of each stretch of this length the quickest arrival is a point of the regression"""
STRETCHES = 120
ENOUGH = 4
"""points before the line is trusted to separate a step of the sensor's clock from a wrong rate"""
UNSURE_STEP_S = 1.0
NOISE_S = 0.5e-3
"""how far the quickest arrivals scatter"""
RATE_UNKNOWN, RATE_KNOWN = 1e-3, 1e-4
"""how far the sensor's rate is expected to be off: of any resonator; of one that was measured before"""
TICK_S = 1e-6
"""outputs are at least this far apart"""


class ClockMap:
    """Maps sensor times to host times: host = sensor + offset, the offset a straight line over sensor time.

    A sample arrives later than it was measured, by a latency that is never negative and comes in bursts (USB frames, a
    latency timer of 16 ms, a busy host).  So the *quickest* arrival of each half second is near the truth.  The line is
    fitted to these of the last minute by least squares, with a weak prior on the slope for the first seconds; those far
    above the others (the host was busy all the time) are left out.

    The sensor's clock has stepped when it runs backwards, when an arrival lies more than ``step_s`` below the line, or
    when all arrivals of two stretches running lie that much above.  Then the fit begins anew with the slope it had;
    ``steps`` counts these, and ``step`` [s] is the last one's size, positive when the sensor's clock fell behind (it
    lost samples, if it counts).

    What remains is the delay of even the quickest sample, which cannot be separated from a clock's offset.
    """

    def __init__(self, step_s: float = 0.1) -> None:
        self.steps = 0
        self.step = 0.0
        self._step_s = step_s
        self._points: deque[tuple[float, float]] = deque(maxlen=STRETCHES)
        self._quickest: tuple[float, float] | None = None
        self._end = 0.0
        self._was_above = False
        self._slope = self._expected_slope = 0.0
        self._sigma = RATE_UNKNOWN
        self._centre = self._level = 0.0
        self._last = -np.inf

    def feed(self, sensor: FloatArray, arrival: float) -> FloatArray:
        """Host times [s] of sensor times [s] that arrived together at host time ``arrival`` [s].

        ``sensor`` ascends, shape (N,), N > 0; so does the result, strictly, over all calls.
        """
        newest = float(sensor[-1])
        self._learn(newest, arrival - newest)
        host: FloatArray = sensor * (1 + self._slope) + (self._level - self._slope * self._centre)
        if host[0] <= self._last:
            host = np.maximum(host, self._last + TICK_S * np.arange(1, len(host) + 1))
        self._last = float(host[-1])
        return host

    def forget(self) -> None:
        """The sensor's clock was set anew: the next arrival begins a new fit, with the slope known so far."""
        self._quickest = None

    def _restart(self, sensor: float, offset: float) -> None:
        self._sigma = RATE_KNOWN if len(self._points) > ENOUGH else RATE_UNKNOWN
        self._expected_slope = self._slope
        self._points.clear()
        self._begin_stretch(sensor, offset)
        self._was_above = False
        self._centre, self._level = sensor, offset

    def _learn(self, sensor: float, offset: float) -> None:
        """Takes in one arrival: its sensor time and the offset that it shows."""
        if self._quickest is None:
            self._restart(sensor, offset)
            return
        above = self._above(sensor, offset)
        if above < -self._threshold() or sensor < self._quickest[0]:
            self._stepped(self._step(sensor, offset), sensor, offset)
        elif sensor >= self._end:
            self._end_stretch(sensor, offset)
        elif above < self._above(*self._quickest):
            self._quickest = sensor, offset
            if above < 0:
                self._fit([*self._points, self._quickest])

    def _end_stretch(self, sensor: float, offset: float) -> None:
        assert self._quickest is not None
        is_above = self._above(*self._quickest) > self._threshold()
        if is_above and self._was_above:
            self._stepped(self._step(*self._quickest), sensor, offset)
            return
        self._was_above = is_above
        if not is_above:
            self._points.append(self._quickest)
            self._fit(list(self._points))
        self._begin_stretch(sensor, offset)

    def _begin_stretch(self, sensor: float, offset: float) -> None:
        self._quickest = sensor, offset
        self._end = sensor + STRETCH_S

    def _stepped(self, step: float, sensor: float, offset: float) -> None:
        self.steps += 1
        self.step = step
        self._restart(sensor, offset)

    def _above(self, sensor: float, offset: float) -> float:
        return offset - self._level - self._slope * (sensor - self._centre)

    def _step(self, sensor: float, offset: float) -> float:
        """How far the offset lies above the line over the host's time, in which the sensor's clock jumps nowhere."""
        return offset - self._level - self._slope * (sensor + offset - self._centre - self._level)

    def _threshold(self) -> float:
        return self._step_s if len(self._points) >= ENOUGH else max(self._step_s, UNSURE_STEP_S)

    def _fit(self, points: list[tuple[float, float]]) -> None:
        """Least squares with the prior on the slope, once more without the points that lie far above the rest."""
        x, y = np.array(points).T
        self._line(x, y)
        if len(points) > ENOUGH:
            above = y - self._level - self._slope * (x - self._centre)
            kept = above <= 3 * np.sort(np.abs(above))[len(points) // 2] + NOISE_S
            self._line(x[kept], y[kept])

    def _line(self, x: FloatArray, y: FloatArray) -> None:
        self._centre, self._level = float(x.mean()), float(y.mean())
        dx = x - self._centre
        weight = (NOISE_S / self._sigma) ** 2
        slope = float(dx @ (y - self._level)) + weight * self._expected_slope
        self._slope = slope / (float(dx @ dx) + weight)
