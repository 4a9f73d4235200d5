"""An accelerometer that sends its samples as CAN frames of one identifier, whatever describes them; it only listens.

``codec/signal.py`` decodes the bits; the bus is in ``can_port.py``.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from lostmotion.drivers.base import AccelBlock, AccelerometerOptions, Identity
from lostmotion.drivers.can_bus import CanFrame
from lostmotion.drivers.can_port import CanPort
from lostmotion.drivers.clock import Clock
from lostmotion.drivers.codec.signal import Layout
from lostmotion.drivers.sensor_rate import LISTEN_S, LOOK_S, SILENCE_S, WAIT_S, check_rate, rate_identity
from lostmotion.drivers.timeline import Timeline

__all__ = ["CanAccelerometer", "Layout"]

NOTHING = np.empty(0)


class CanAccelerometer:
    """See ``base.Accelerometer``.

    Times are evened (``timeline.py``): by the number of frames, since one waits for others on the bus; where the frames
    carry a counter by that, which also shows which ones were lost.
    """

    def __init__(
        self, options: AccelerometerOptions, layout: Layout, counter: Layout | None, range_ms2: float, clock: Clock
    ) -> None:
        """Raises DriverError when the rate is too low for the oscillator."""
        check_rate(options)
        self.range_ms2 = min(range_ms2, layout.largest)
        self._limit = range_ms2
        self._name, self._rate = options.name, options.rate_hz
        self._layout, self._counter = layout, counter
        self._clock = clock
        bus: Any = options  # each of them has a bus's keys
        self._port = CanPort(bus, clock.now)
        self._looked = -math.inf
        self._fresh = True
        self._begin()

    def open(self) -> None:
        """Takes the bus.  Raises PortError."""
        self._begin()
        self._port.open()

    def identify(self) -> tuple[Identity, ...]:
        """Measures how often the frame comes; where it does not, reports which others come.  Raises PortError."""
        frame = f"frame 0x{self._layout.id:X}"
        expected = f"{frame} at {self._rate:g} Hz"
        self._port.only(None)
        times, short, others = self._listen()
        self._port.only({self._layout.id})
        self._fresh = True
        if len(times) < 2:
            found, gist = self._missing(short, others)
            return (Identity(self._name, found, expected, False, gist),)
        rate = (len(times) - 1) / (times[-1] - times[0]) if times[-1] > times[0] else math.inf
        cause = "rate_hz is not what the sensor is set to, or the bus is too slow for it"
        return (rate_identity(self._name, frame, rate, self._rate, expected, cause),)

    def read(self) -> AccelBlock:
        """The samples since the last call; waits for some up to 0.25 s.  Raises PortError."""
        if self._fresh:  # what waited before the first read would look as if it came late
            self._port.read(0.0)
            self._fresh = False
        frames = self._port.read(WAIT_S) if self._port.stamped else self._unstamped()
        broken, self._port.broken = self._port.broken, 0
        id = self._layout.id
        frames = [frame for frame in frames if frame.id == id]
        if not frames:
            return AccelBlock(NOTHING, NOTHING, broken=broken)
        data, arrival = [frame.data for frame in frames], frames[-1].time
        accel = self._layout.values(data)
        if self._limit < math.inf:
            accel[~(np.abs(accel) <= self._limit)] = np.nan
        broken += int(np.count_nonzero(np.isnan(accel)))
        if self._counter is None:
            return self._timeline.counted(accel, arrival, broken)
        stamps = self._counter.numbers(data) / self._rate
        whole = ~np.isnan(stamps)
        if not whole.any():
            return AccelBlock(NOTHING, NOTHING, broken=broken)
        return self._timeline.stamped(stamps[whole], accel[whole], arrival, broken)

    def close(self) -> None:
        """Gives the bus back."""
        self._port.close()

    def _begin(self) -> None:
        wraps = 2.0**self._counter.bits / self._rate if self._counter else None
        self._timeline = Timeline(1 / self._rate, wraps)
        self._fresh = True

    def _unstamped(self) -> list[CanFrame]:
        frames = self._port.read(0.0)
        if not frames or self._clock.now() > self._looked + LOOK_S:
            frames += self._port.read(WAIT_S)
            self._looked = self._clock.now()
        return frames

    def _listen(self) -> tuple[list[float], int, set[int]]:
        """When the frames came [s] after the first look, how many were too short, and which others came."""
        self._port.read(0.0)
        end = self._clock.now() + SILENCE_S
        times: list[float] = []
        short, others = 0, set[int]()
        while (now := self._clock.now()) < end:
            for frame in self._port.read(min(0.05, end - now)):
                if frame.id != self._layout.id:
                    others.add(frame.id)
                elif len(frame.data) < self._layout.ends:
                    short += 1
                else:
                    if not times:
                        end = min(end, now + LISTEN_S)
                    times.append(frame.time)
        return times, short, others

    def _missing(self, short: int, others: set[int]) -> tuple[str, str]:
        """What came instead of the frame, with and without what differs between looks."""
        if self._port.foreign and not (short or others):
            return self._port.foreign_words()
        if short:
            text = (
                f"frames too short for the signal, which ends in byte {self._layout.ends}; likely cause: another layout"
            )
            return text, text
        if not others:
            text = f"no frame at all in {SILENCE_S:g} s; likely cause: no power, another bitrate, or no master"
            return text, text
        ids = ", ".join(f"0x{id:X}" for id in sorted(others)[:6])
        text = "only {}; likely cause: another identifier, or a node that was not started"
        return text.format(ids), text.format("other frames")
