"""Sensors that send on their own accord, byte for byte, with faults on request.  No I/O of their own."""

from __future__ import annotations

import math
import random

import numpy as np

from lostmotion.drivers.codec import witmotion
from lostmotion.drivers.emulator.motion import NOISE_MS2, Motion

__all__ = ["CsvStream", "TextStream", "WitMotionStream"]

COUNTER = 2**32
GRAVITY_MS2 = 9.81
AWAKE_S = 1.0
"""a device that has not been served for this long was off"""


class _Stream:
    """Sends sample after sample of a tabulated signal, in bursts as a USB adapter does.

    ``insert`` puts foreign bytes into the stream; ``skip`` loses samples.  Until it is taken back: ``held`` sends the
    same sample again and again, ``lossy`` is the share of the bytes that is lost.
    """

    def __init__(self, table: list[bytes], rate_hz: float, burst_s: float = 0.005) -> None:
        self._table = table
        self._rate = rate_hz
        self._burst = burst_s
        self._inserted = b""
        self._next = 0
        self._due = -math.inf
        self.held = False
        self.lossy = 0.0
        self._dice = random.Random(1)

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
        data += b"".join([self._sample(index) for index in range(start, end)])
        return bytes(byte for byte in data if self._dice.random() >= self.lossy) if self.lossy else data

    def _sample(self, index: int) -> bytes:
        return self._table[0 if self.held else index % len(self._table)]


class WitMotionStream(_Stream):
    """A WitMotion sensor sending acceleration frames; the bar moves along one axis, gravity is on z, all are noisy."""

    def __init__(self, motion: Motion, rate_hz: float = 200.0, axis: str = "x") -> None:
        tip = motion.tip(rate_hz)
        axes = np.random.default_rng(2).normal(0, NOISE_MS2, (3, tip.size))
        axes[2] += GRAVITY_MS2
        axes["xyz".index(axis)] = tip
        raw = np.clip(np.rint(axes / witmotion.FULL_SCALE_MS2 * 32768), -32768, 32767).astype(int)
        frames = []
        for values in raw.T.tolist():
            frame = witmotion.WitFrame(witmotion.ACCELERATION, (*values, 2500))
            frames.append(witmotion.encode(frame))
        super().__init__(frames, rate_hz)


class CsvStream(_Stream):
    """A microcontroller printing ``t_us,value``; ``clock_us`` is the reading of its clock at time 0 of the host (set it
    to make the clock step), ``ppm`` by how much it runs fast."""

    def __init__(self, motion: Motion, rate_hz: float = 1000.0, stamps: bool = True, ppm: float = 0.0) -> None:
        super().__init__([b"%.4f\r\n" % value for value in motion.tip(rate_hz)], rate_hz)
        self.clock_us = 0
        self._stamps = stamps
        self._tick_us = 1e6 / rate_hz * (1 + ppm * 1e-6)

    def _sample(self, index: int) -> bytes:
        value = super()._sample(index)
        return b"%d,%b" % ((self.clock_us + round(index * self._tick_us)) % COUNTER, value) if self._stamps else value


class TextStream(_Stream):
    """Some other device on the port, such as a GPS receiver: the same text over and over."""

    def __init__(self, text: bytes = b"$GPGGA,123519,4807.038,N,01131.000,E,1,08,0.9,545.4,M,46.9,M,,*47\r\n") -> None:
        super().__init__([text], 10.0, 0.1)
