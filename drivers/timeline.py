"""A sensor's samples → blocks in robot time, with what was lost, late or broken counted.  Pure: time comes in as an
argument.  ``codec`` decodes bytes, ``clockmap.py`` has the regression behind the times.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from lostmotion.drivers.base import AccelBlock, FloatArray
from lostmotion.drivers.clockmap import ClockMap
from lostmotion.drivers.ticks import COARSE, Ticks

__all__ = ["Timeline"]

MAX_GAP_S = 1.0
"""a longer gap is a clock that was set anew, not samples that were lost"""
LATE_S, LATE_PERIODS = 0.25, 3
"""a sample is late when it comes this long after it was measured, and at least that many periods"""
LEAST_STEP_S = 3e-3
TINY = 1e-9
"""the least step between two stamps of a fine clock [s]"""
NOTHING = np.empty(0)


class Timeline:
    """Gives the samples of one sensor their robot times.

    ``period`` [s] is the nominal sample period; ``wraps`` [s] the time after which the sensor's clock begins at 0 again
    (inf: never), None for a sensor that sends no time.

    ``tick`` [s]: in such steps the sensor's clock goes on; where they are coarse, the times between are evened
    (``ticks.py``).

    ``stamped`` takes samples with the sensor's own times: a gap in them is filled with NaN and counted as lost.
    ``counted`` takes samples without: the clock is the number of samples so far times the period.  Samples that
    vanished without a trace show up as a step of that clock about a second later, and are counted then.

    ``is_robot_time``: the stamps are robot times already, and are kept.
    """

    def __init__(
        self, period: float, wraps: float | None = None, tick: float = 0.0, is_robot_time: bool = False
    ) -> None:
        self._period = period
        self._is_robot_time = is_robot_time
        self._last_time = -math.inf
        self._least = 0.0 if tick > COARSE * period else TINY
        self._ticks = Ticks(period, tick) if tick > COARSE * period else None
        self._counts = wraps is None
        self._wraps = math.inf if wraps is None else wraps
        self._late = max(LATE_S, LATE_PERIODS * period)
        self._map = ClockMap() if wraps is not None else ClockMap(max(0.8 * period, LEAST_STEP_S))
        self._count = 0
        self._time = math.nan  # of the last sample on the sensor's clock without wraps
        self._stamp = math.nan  # the same as it was sent
        self._even = math.nan  # of the last sample, evened
        self._odd: float | None = None  # the last stamp, if it did not follow the one before

    def counted(self, accel: Sequence[float] | FloatArray, arrival: float, broken: int = 0) -> AccelBlock:
        """The block of samples [m/s²] that arrived together at ``arrival`` [s]; NaN stands for a broken one."""
        count = len(accel)
        sensor = (self._count + np.arange(1.0, count + 1)) * self._period
        self._count += count
        return self._block(sensor, np.asarray(accel), arrival, 0, broken)

    def stamped(
        self, stamps: Sequence[float] | FloatArray, accel: Sequence[float] | FloatArray, arrival: float, broken: int = 0
    ) -> AccelBlock:
        """The same for samples with the sensor's own times [s]; those that fit nowhere in time are broken ones."""
        stamps, accel = np.asarray(stamps), np.asarray(accel)
        start, before = self._time, self._stamp
        first, last, steps = float(stamps[0]), float(stamps[-1]), stamps[1:] - stamps[:-1]
        longest = 1.5 * self._period
        # So it nearly always is; NaN compares false.
        if (
            self._ticks is None
            and 0 < first - before < longest
            and steps.min(initial=longest) > 0
            and steps.max(initial=0.0) < longest
        ):
            self._stamp, self._time, self._odd = last, start + (last - before), None
            return self._block(stamps + (start - before), accel, arrival, 0, broken)
        kept = [
            (advance, value)
            for stamp, value in zip(stamps.tolist(), accel.tolist(), strict=True)
            if (advance := self._advance(stamp)) is not None
        ]
        broken += len(stamps) - len(kept)
        if not kept:
            return AccelBlock(NOTHING, NOTHING, broken=broken)
        advances, values = np.array(kept).T
        start, self._time = self._time, self._time + float(advances.sum())
        sensor = start + np.cumsum(advances)
        if self._ticks is None:
            missing = np.maximum(np.rint(advances / self._period).astype(int) - 1, 0)
        else:
            before_first = self._even
            sensor, skipped = self._ticks.feed(sensor)
            start, self._even, missing = before_first, float(sensor[-1]), skipped.astype(int)
        lost = int(missing.sum())
        if lost:
            sensor, values = _fill(start, sensor, values, missing)
        # a broken line leaves a gap, too: each missing sample is counted once
        return self._block(sensor, values, arrival, max(0, lost - broken), broken)

    def _advance(self, stamp: float) -> float | None:
        """How far the sensor's clock went on with this sample; None for a stamp that fits nowhere.

        One stamp that does not follow the last is thrown away; when the next follows it, the clock was set anew.
        """
        if math.isnan(self._time):
            self._time = self._stamp = stamp
            return 0.0
        advance = self._forward(stamp, self._stamp)
        if not self._least <= advance <= MAX_GAP_S:
            follows = self._odd is not None and self._least <= self._forward(stamp, self._odd) <= MAX_GAP_S
            self._odd = stamp
            if not follows:
                return None
            advance = self._period
            self._map.forget()
        self._odd = None
        self._stamp = stamp
        return advance

    def _forward(self, stamp: float, before: float) -> float:
        advance = stamp - before
        return advance + self._wraps if advance < -self._wraps / 2 else advance

    def _block(self, sensor: FloatArray, accel: FloatArray, arrival: float, lost: int, broken: int) -> AccelBlock:
        if self._is_robot_time:
            return self._kept(sensor, accel, arrival, lost, broken)
        steps = self._map.steps
        time = self._map.feed(sensor, arrival)
        if self._map.steps > steps and self._counts:
            lost = max(0, round(self._map.step / self._period))
        return self._looked_at(time, accel, arrival, lost, broken)

    def _kept(self, sensor: FloatArray, accel: FloatArray, arrival: float, lost: int, broken: int) -> AccelBlock:
        """The block of stamps that are robot times; one set anew is where it was set to, but never before the last."""
        time = sensor + (self._stamp - self._time)
        if time[0] <= self._last_time:
            time = np.maximum(time, self._last_time + TINY * np.arange(1, len(time) + 1))
        self._last_time = float(time[-1])
        return self._looked_at(time, accel, arrival, lost, broken)

    def _looked_at(self, time: FloatArray, accel: FloatArray, arrival: float, lost: int, broken: int) -> AccelBlock:
        late = 0 if arrival - time[0] <= self._late else int(np.count_nonzero(arrival - time > self._late))
        return AccelBlock(time, accel, lost, late, broken)


def _fill(
    start: float, sensor: FloatArray, values: FloatArray, missing: np.ndarray[tuple[int, ...], np.dtype[np.int_]]
) -> tuple[FloatArray, FloatArray]:
    """The samples on a grid without gaps: NaN at the missing instants, which divide each gap evenly."""
    index = np.cumsum(missing + 1)
    everywhere = np.arange(1, index[-1] + 1)
    filled = np.full(len(everywhere), np.nan)
    filled[index - 1] = values
    return np.interp(everywhere, np.append(0, index), np.append(start, sensor)), filled
