"""Sensors that send on their own accord, byte for byte, with faults on request.  No I/O of their own."""

from __future__ import annotations

import math

from lostmotion.drivers.codec import witmotion
from lostmotion.drivers.emulator.motion import Motion

__all__ = ["CsvStream", "TextStream", "WitMotionStream"]

COUNTER = 2**32
AWAKE_S = 1.0
"""a device that has not been served for this long was off"""


class _Stream:
    """Sends sample after sample of a tabulated signal, in bursts as a USB adapter does.

    ``insert`` puts foreign bytes into the stream; ``skip`` loses samples.
    """

    def __init__(self, table: list[bytes], rate_hz: float, burst_s: float) -> None:
        self._table = table
        self._rate = rate_hz
        self._burst = burst_s
        self._inserted = b""
        self._next = 0
        self._due = -math.inf

    def insert(self, data: bytes) -> None:
        """These bytes come before the next sample."""
        self._inserted += data

    def skip(self, samples: int) -> None:
        """The next samples are lost on the way."""
        self._next += samples

    def receive(self, data: bytes, now: float) -> None:
        """A command from the host: such a sensor ignores it."""

    def due(self) -> float:
        """When the next burst goes out [s]."""
        return self._due

    def emit(self, now: float) -> bytes:
        """All samples up to now; sample i is measured at i / rate on the clock of the host."""
        end = math.floor(now * self._rate) + 1
        if self._due < now - AWAKE_S:  # switched on just now
            self._next, self._due = end, now
        start, self._next = min(self._next, end), max(self._next, end)
        self._due += self._burst
        data, self._inserted = self._inserted, b""
        return data + b"".join([self._sample(index) for index in range(start, end)])

    def _sample(self, index: int) -> bytes:
        return self._table[index % len(self._table)]


class WitMotionStream(_Stream):
    """A WitMotion sensor sending acceleration frames; the bar moves along one axis, gravity lies on z."""

    def __init__(self, motion: Motion, rate_hz: float = 200.0, axis: str = "x", burst_s: float = 0.005) -> None:
        raw = [round(value / witmotion.FULL_SCALE_MS2 * 32768) for value in motion.tip(rate_hz)]
        at = "xyz".index(axis)
        frames = []
        for value in raw:
            values = [0, 0, 2048, 2500]
            values[at] = max(-32768, min(32767, value))
            frame = witmotion.WitFrame(witmotion.ACCELERATION, (values[0], values[1], values[2], values[3]))
            frames.append(witmotion.encode(frame))
        super().__init__(frames, rate_hz, burst_s)


class CsvStream(_Stream):
    """A microcontroller printing ``t_us,value``; ``clock_us`` is the reading of its clock at time 0 of the host (set it
    to make the clock step), ``ppm`` by how much it runs fast."""

    def __init__(
        self, motion: Motion, rate_hz: float = 1000.0, stamps: bool = True, ppm: float = 0.0, burst_s: float = 0.005
    ) -> None:
        super().__init__([b"%.4f\r\n" % value for value in motion.tip(rate_hz)], rate_hz, burst_s)
        self.clock_us = 0
        self._stamps = stamps
        self._tick_us = 1e6 / rate_hz * (1 + ppm * 1e-6)

    def _sample(self, index: int) -> bytes:
        value = self._table[index % len(self._table)]
        return b"%d,%b" % ((self.clock_us + round(index * self._tick_us)) % COUNTER, value) if self._stamps else value


class TextStream(_Stream):
    """Some other device on the port, such as a GPS receiver: the same text over and over."""

    def __init__(self, text: bytes = b"$GPGGA,123519,4807.038,N,01131.000,E,1,08,0.9,545.4,M,46.9,M,,*47\r\n") -> None:
        super().__init__([text], 10.0, 0.1)
