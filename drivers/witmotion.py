"""Driver of WitMotion's serial inertial sensors (WT901, JY901 and like): ±16 g, at most 200 readings a second.

``codec/witmotion.py`` decodes frames; ports, identity and times are in ``serial_accelerometer.py``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType
from typing import Literal

import numpy as np

from lostmotion.drivers.base import (
    Accelerometer,
    AccelerometerOptions,
    Baudrate,
    Driver,
    FloatArray,
    Port,
    RobotOptions,
)
from lostmotion.drivers.clock import Clock
from lostmotion.drivers.codec import witmotion as codec
from lostmotion.drivers.errors import DriverError
from lostmotion.drivers.serial_accelerometer import Readings, SerialAccelerometer

__all__ = ["DRIVER", "WitMotionOptions"]

MAX_RATE_HZ = 200.0
AXES: Mapping[str, int] = MappingProxyType({"x": 0, "y": 1, "z": 2})


class WitMotionOptions(AccelerometerOptions, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """baudrate [bit/s]; axis: the sensor's axis that points along the motion of the bar's free end."""

    port: Port
    baudrate: Baudrate = 115200
    rate_hz: float = MAX_RATE_HZ
    axis: Literal["x", "y", "z", "-x", "-y", "-z"] = "x"

    def line_bytes(self) -> int:
        """A frame; the sensor may be set to send others, too."""
        return codec.FRAME_SIZE


class WitMotionFormat:
    """The acceleration along one axis.  The sensor sends no clock, and other frames are passed over."""

    name = "WitMotion sensor"
    range_ms2 = codec.FULL_SCALE_MS2
    wraps = None
    tick = 0.0

    def __init__(self, axis: str) -> None:
        self._index = AXES[axis[-1]]
        self._sign = -1.0 if axis.startswith("-") else 1.0
        self._decoder = codec.WitDecoder()
        self._only_acceleration = True

    def feed(self, data: bytes) -> Readings:
        frames = self._decoder.accelerations(data)
        if frames is not None:
            return Readings(self._ms2([values[self._index] for values in frames]), None, 0)
        raw: list[float] = []
        broken = 0
        for frame in self._decoder.feed(data):
            if frame is None:
                broken += 1
                if self._only_acceleration:  # then it was a reading, and keeps its place in time
                    raw.append(math.nan)
            elif frame.kind == codec.ACCELERATION:
                raw.append(frame.values[self._index])
            else:
                self._only_acceleration = False
        return Readings(self._ms2(raw), None, broken)

    def _ms2(self, raw: list[float]) -> FloatArray:
        return self._sign * codec.to_ms2(np.array(raw, np.float64))

    def reset(self) -> None:
        self._decoder.reset()
        self._only_acceleration = True


def _make(options: AccelerometerOptions, robot: RobotOptions, clock: Clock) -> Accelerometer:
    assert isinstance(options, WitMotionOptions)
    if options.rate_hz > MAX_RATE_HZ:
        raise DriverError(
            f"accelerometer {options.name}: rate_hz is {options.rate_hz:g}; a WitMotion sensor sends at most"
            f" {MAX_RATE_HZ:g} a second"
        )
    return SerialAccelerometer(options, options.baudrate, WitMotionFormat(options.axis), clock)


DRIVER = Driver(
    name="witmotion",
    summary="WitMotion serial inertial sensor, ±16 g, up to 200 Hz",
    accelerometer=_make,
    accelerometer_options=WitMotionOptions,
)
