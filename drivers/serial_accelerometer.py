"""What all accelerometers on a serial port have in common: opening, identity by rate, reading, robot times.

A ``Format`` decodes their bytes: ``witmotion.py``, ``csv_serial.py``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from lostmotion.drivers.base import AccelBlock, AccelerometerOptions, FloatArray, Identity
from lostmotion.drivers.clock import Clock
from lostmotion.drivers.sensor_rate import LISTEN_S, LOOK_S, RATE_TOLERANCE, SILENCE_S, WAIT_S, check_rate
from lostmotion.drivers.serial_port import SerialPort
from lostmotion.drivers.ticks import coarser
from lostmotion.drivers.timeline import Timeline

__all__ = ["Format", "Readings", "SerialAccelerometer"]

NOTHING = np.empty(0)
LEAST_STAMPS = 50
"""fewer say nothing about the pace of a clock"""


@dataclass(frozen=True, slots=True)
class Readings:
    """What a chunk of bytes held: accelerations [m/s²], shape (N,), NaN for a broken one; the sensor's own times [s] of
    each, (N,), or None if it sends none; how many frames or lines were broken; how many of the NaN the sensor itself
    reports as lost."""

    accel: FloatArray
    stamps: FloatArray | None
    broken: int
    lost: int = 0


class Format(Protocol):
    """How one kind of sensor speaks.

    name: as a person calls it; range_ms2: the largest acceleration it can show [m/s²]; wraps, tick: see ``Timeline``.
    """

    @property
    def name(self) -> str: ...

    @property
    def range_ms2(self) -> float: ...

    @property
    def wraps(self) -> float | None: ...

    @property
    def tick(self) -> float: ...

    def feed(self, data: bytes) -> Readings:
        """The readings that are complete now."""
        ...

    def reset(self) -> None:
        """The port was opened anew."""
        ...


class SerialAccelerometer:
    """An accelerometer on a serial port, sending on its own accord; see ``base.Accelerometer``."""

    def __init__(self, options: AccelerometerOptions, baudrate: int, form: Format, clock: Clock) -> None:
        """Raises DriverError when the rate is too low for the oscillator."""
        check_rate(options)
        self.range_ms2 = form.range_ms2
        self._name = options.name
        self._rate = rate = options.rate_hz
        self._form = form
        self._clock = clock
        self._port = SerialPort(options.port, baudrate)
        self._timeline = Timeline(1 / rate, form.wraps, form.tick)
        self._fresh = True
        self._looked = -math.inf

    def open(self) -> None:
        """Takes the port.  Raises PortError."""
        self._port.open()
        self._timeline = Timeline(1 / self._rate, self._form.wraps, self._form.tick)
        self._fresh = True

    def identify(self) -> tuple[Identity, ...]:
        """Measures the rate of the readings; whatever else comes in is shown as it is.  Raises PortError."""
        expected = f"{self._form.name} at {self._rate:g} Hz"
        self._form.reset()
        count, span, broken, seen, stamps = self._listen()
        self._fresh = True
        self._timeline = Timeline(1 / self._rate, self._form.wraps, coarser(stamps, self._form.tick, 1 / self._rate))
        if count < 2:
            what = "nothing" if not seen else "bytes that are none of its"
            cause = "unpowered, or another port" if not seen else "another device on the port, or a wrong baudrate"
            when = f" in {SILENCE_S:g} s; likely cause: {cause}"
            excerpt = f" ({seen[:24]!r})" if seen else ""
            return (Identity(self._name, what + excerpt + when, expected, False, what + when),)
        rate = (count - 1) / span
        ok = abs(rate / self._rate - 1) <= RATE_TOLERANCE and broken <= 0.1 * count
        found = f"{self._form.name} at {rate:.0f} Hz" + (f", {broken} broken of {count + broken}" if broken else "")
        if ok and stamps.size > LEAST_STAMPS and (wrong := _wrong_pace(stamps, 1 / self._rate)):
            return (Identity(self._name, f"{found}{wrong}", expected, False, f"{self._form.name}{wrong}"),)
        if ok:
            return (Identity(self._name, found, expected, ok),)
        cause = "; likely cause: rate_hz is not what the sensor is set to, or the line is too slow or noisy for it"
        gist = f"{self._form.name} at about {float(f'{rate:.1g}'):g} Hz" + (", some broken" if broken else "")
        if broken > 0.1 * count:  # the rate of what is left differs from look to look
            gist = f"{self._form.name}, many of them broken"
        return (Identity(self._name, found + cause, expected, ok, gist + cause),)

    def read(self) -> AccelBlock:
        """The samples since the last call; waits for some up to 0.25 s.  Raises PortError."""
        if self._fresh:  # what waited before the first read would look as if it came late
            self._port.discard_input()
            self._form.reset()
            self._fresh = False
        data = self._port.read(0.0)
        # Nobody knows for how long these bytes have been there: now and then the clock map has to see some arrive.
        if not data or self._clock.now() > self._looked + LOOK_S:
            data += self._port.read(WAIT_S)
            self._looked = self._clock.now()
        arrival = self._clock.now()
        readings = self._form.feed(data)
        if not readings.accel.size:
            return AccelBlock(NOTHING, NOTHING, broken=readings.broken)
        if readings.stamps is None:
            block = self._timeline.counted(readings.accel, arrival, readings.broken)
            return replace(block, lost=block.lost + readings.lost) if readings.lost else block
        return self._timeline.stamped(readings.stamps, readings.accel, arrival, readings.broken)

    def close(self) -> None:
        """Gives the port back."""
        self._port.close()

    def _listen(self) -> tuple[int, float, int, bytes, FloatArray]:
        """Number of readings after the first chunk, and the time they took [s]; broken ones; the first bytes; all
        stamps [s]."""
        start = self._clock.now()
        first = last = None
        stamps = [NOTHING]
        count = broken = 0
        seen = b""
        while (now := self._clock.now()) < (start + SILENCE_S if first is None else first + LISTEN_S):
            data = self._port.read(0.05)
            seen = seen or data
            readings = self._form.feed(data)
            stamps += [readings.stamps] if readings.stamps is not None else []
            good = int(np.count_nonzero(np.isfinite(readings.accel)))
            if first is not None:
                broken += readings.broken
            if not good:
                continue
            # The last reading of a chunk is as fresh as the chunk; those of the first chunk may have waited for long.
            now = self._clock.now()
            if first is None:
                first, count = now, 1
            else:
                count, last = count + good, now
        known = (count, last - first) if first is not None and last is not None else (0, 0.0)
        return (*known, broken, seen, np.concatenate(stamps))


def _wrong_pace(stamps: FloatArray, period: float) -> str:
    """What is wrong with a clock whose stamps [s] go on by less than half of the period [s] from one to the next, or by
    more than twice as much, in most of eight blocks; "" for nothing."""
    at = np.linspace(0, len(stamps) - 1, 9).astype(int)
    paces = np.sort(np.diff(stamps[at]) / np.diff(at))
    pace = float(paces[3:5].mean()) / period  # their median; numpy.median brings 1 MB (numpy.ma) into the service
    if not (pace < 0.5 or pace > 2.0):
        return ""
    fault = "stand still or run back" if pace < 1e-6 else f"go on too {'slowly' if pace < 1 else 'fast'}"
    return f" whose times {fault}; likely cause: time_column is not the sensor's clock, or time_unit is another one"
