"""Driver of a microcontroller that prints one reading a line: ``value``, or ``t_us,value``, or more columns.

``codec/csv_line.py`` parses lines; ports, identity and times are in ``serial_accelerometer.py``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
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
from lostmotion.drivers.codec.csv_line import CsvDecoder
from lostmotion.drivers.serial_accelerometer import Readings, SerialAccelerometer

__all__ = ["DRIVER", "CsvSerialOptions"]

SECONDS: Mapping[str, float] = MappingProxyType({"s": 1.0, "ms": 1e-3, "us": 1e-6})
COUNTER = 2**32
"""micros() and millis() of a microcontroller begin again at 0 after this many"""


class CsvSerialOptions(AccelerometerOptions, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """baudrate [bit/s]; column: the one that holds the reading, counted from 0, or from the end by -1; scale: m/s² per
    unit of the reading, negative to turn its sign; range_ms2: the largest acceleration the sensor can show [m/s²];
    time_column: the one that holds the sensor's own time, if there is one, in ``time_unit``.
    """

    port: Port
    baudrate: Baudrate = 115200
    column: int = -1
    scale: float = 1.0
    range_ms2: float = math.inf
    time_column: int | None = None
    time_unit: Literal["s", "ms", "us"] = "us"

    def __post_init__(self) -> None:
        """Refuses a scale that makes every reading zero, and a time that is the reading."""
        if self.scale == 0.0:
            raise ValueError("scale: found 0, expected m/s² per unit of the reading, such as 1 or 9.81")
        if self.time_column == self.column:
            raise ValueError(f"time_column: found {self.column}, which is the column of the reading; expected another")

    def line_bytes(self) -> int:
        """A digit and a separator for each column that there must be, and the digits of the time after 1000 s."""
        used = [column for column in (self.column, self.time_column) if column is not None]
        columns = max(len(used), *(1 + column if column >= 0 else -column for column in used))
        return 2 * columns + (0 if self.time_column is None else round(math.log10(1000 / SECONDS[self.time_unit])))


class CsvFormat:
    """One column of the lines as acceleration, another one as the sensor's clock."""

    name = "lines of numbers"

    def __init__(self, options: CsvSerialOptions) -> None:
        self.range_ms2 = options.range_ms2
        self._column = options.column
        self._scale = options.scale
        self._time_column = options.time_column
        self._unit = SECONDS[options.time_unit]
        whole_numbers = options.time_unit != "s"
        self.wraps = None if options.time_column is None else COUNTER * self._unit if whole_numbers else math.inf
        self.tick = self._unit if whole_numbers else 0.0
        self._decoder = CsvDecoder()

    def feed(self, data: bytes) -> Readings:
        rows: FloatArray | list[tuple[float, ...] | None] | None = self._decoder.table(data)
        if rows is None:
            rows = self._decoder.feed(data)
        lost, self._decoder.lost = self._decoder.lost, 0
        accel = _column(rows, self._column) * self._scale
        if self.range_ms2 < math.inf:
            accel[~(np.abs(accel) <= self.range_ms2)] = np.nan
        if self._time_column is None:
            return Readings(accel, None, int(np.count_nonzero(np.isnan(accel))) - lost, lost)
        stamps = _column(rows, self._time_column) * self._unit
        if math.isfinite(accel.sum() + stamps.sum()):  # nothing is NaN, as nearly always
            return Readings(accel, stamps, 0)
        broken = int(np.count_nonzero(np.isnan(accel + stamps))) - lost  # the gap in the stamps shows what is lost
        timed = ~np.isnan(stamps)
        return Readings(accel[timed], stamps[timed], broken)

    def reset(self) -> None:
        self._decoder.reset()


def _column(rows: FloatArray | Sequence[tuple[float, ...] | None], column: int) -> FloatArray:
    """One column of lines, NaN where a line is broken or too short."""
    if isinstance(rows, np.ndarray) and -rows.shape[1] <= column < rows.shape[1]:
        return np.asarray(rows[:, column])
    return np.array([row[column] if row is not None and -len(row) <= column < len(row) else np.nan for row in rows])


def _make(options: AccelerometerOptions, robot: RobotOptions, clock: Clock) -> Accelerometer:
    assert isinstance(options, CsvSerialOptions)
    return SerialAccelerometer(options, options.baudrate, CsvFormat(options), clock)


DRIVER = Driver(
    name="csv_serial",
    summary="microcontroller printing one reading a line over a serial port",
    accelerometer=_make,
    accelerometer_options=CsvSerialOptions,
)
