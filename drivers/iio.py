"""Driver of accelerometers that the Linux kernel drives (ADXL345, ADXL355, ADXL372, LIS3DH, MPU6050, KX022A, …):
the IIO buffer with the kernel's time stamps.

Attributes are in ``iio_sysfs.py``, frames in ``codec/iio_scan.py``, what is set before measuring in ``iio_setup.py``.
"""

from __future__ import annotations

import errno
import fcntl
import logging
import math
import os
import select
import threading
from pathlib import Path
from typing import Annotated, Literal

import msgspec
import numpy as np

from lostmotion.drivers.base import (
    AccelBlock,
    Accelerometer,
    AccelerometerOptions,
    Driver,
    Identity,
    RobotOptions,
)
from lostmotion.drivers.clock import Clock
from lostmotion.drivers.errors import DriverError, PortError
from lostmotion.drivers.holders import holders
from lostmotion.drivers.iio_setup import Setup, set_up
from lostmotion.drivers.iio_sysfs import IioDevice, Settings, find_device, refusal
from lostmotion.drivers.sensor_rate import LISTEN_S, LOOK_S, SILENCE_S, WAIT_S, check_rate, rate_identity
from lostmotion.drivers.timeline import Timeline

__all__ = ["DRIVER", "IioAccelerometer", "IioOptions"]

log = logging.getLogger(__name__)

ROOT = "LOSTMOTION_IIO_ROOT"
FRAMES = 4096
"""read at once, at most"""
NOTHING = np.empty(0)


class IioOptions(AccelerometerOptions, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """device: its name, label or index, as in /sys/bus/iio/devices; axis: the sensor's axis that points along the
    motion of the bar's free end, after the mount matrix of the device tree if there is one; trigger: the name of the
    one that paces the sensor, "" for its own; root: where sys and dev are, / unless the environment
    sets LOSTMOTION_IIO_ROOT.
    """

    device: Annotated[str, msgspec.Meta(min_length=1)]
    axis: Literal["x", "y", "z", "-x", "-y", "-z"] = "x"
    trigger: str = ""
    root: str = ""


class IioAccelerometer:
    """An accelerometer behind an IIO buffer; see ``base.Accelerometer``.

    What is set for measuring (elements of the scan, rate, trigger, buffer, clock) is put back by ``close``.
    """

    def __init__(self, options: IioOptions, clock: Clock) -> None:
        self.range_ms2 = math.inf
        self._options = options
        self._clock = clock
        self._root = Path(options.root or os.environ.get(ROOT, "/"))
        self._settings = Settings()
        self._busy = threading.RLock()
        self._poll = select.poll()
        self._fd = -1
        self._rest = b""
        self._look_again = -math.inf
        self._is_robot_time = False
        self._device: IioDevice | None = None
        self._setup: Setup | None = None
        self._timeline = Timeline(1 / options.rate_hz)

    def open(self) -> None:
        """Takes the device, sets it up and starts its buffer.  Raises PortError, and DriverError for what the device
        cannot do."""
        self.close()
        with self._busy:
            try:
                self._start(find_device(self._root, self._options.device))
            except DriverError:
                self.close()
                raise

    def identify(self) -> tuple[Identity, ...]:
        """Measures the rate of the samples.  Raises PortError."""
        device = self._device or self._options.device
        expected = f"{self._options.device} at {self._options.rate_hz:g} Hz"
        count, span = self._listen()
        if count < 2:
            what = (
                f"{device}, which gives no samples in {SILENCE_S:g} s; likely cause: its interrupt or trigger is dead"
            )
            return (Identity(self._options.name, what, expected, False),)
        cause = "a bus too slow for this rate, or a trigger of another rate"
        rate, wanted = (count - 1) / span, self._options.rate_hz
        return (rate_identity(self._options.name, str(device), rate, wanted, expected, cause),)

    def read(self) -> AccelBlock:
        """The samples since the last call; waits for some up to 0.25 s.  Raises PortError."""
        with self._busy:
            frames = self._receive(0)
            # By a foreign clock, or none, the clock map has to see some arrive now and then.
            if not frames or (self._clock.now() > self._look_again and not self._is_robot_time):
                frames += self._receive(WAIT_S * 1000)
                self._look_again = self._clock.now() + LOOK_S
            setup, arrival = self._setup, self._clock.now()
        if not frames or setup is None:
            return AccelBlock(NOTHING, NOTHING)
        accel, stamps = setup.samples(frames)
        if stamps is None:
            return self._timeline.counted(accel, arrival)
        return self._timeline.stamped(stamps, accel, arrival)

    def close(self) -> None:
        """Stops the buffer, and puts back what had been set before."""
        fd, self._fd = self._fd, -1
        with self._busy:
            self._settings.restore()
            if fd >= 0:
                os.close(fd)
            self._setup = None
            self._rest = b""

    def _start(self, device: IioDevice) -> None:
        if not device.has("buffer/enable"):
            raise DriverError(
                f"{device} has no buffer; expected buffer/enable in {device.folder}; likely cause: a kernel without "
                "CONFIG_IIO_TRIGGERED_BUFFER, or one whose driver of this sensor has none yet (ADXL345: before 6.15)"
            )
        self._fd = self._take(device)
        if device.read("buffer/enable") == "1":  # nobody holds it: see _take
            log.warning("%s: its buffer was left running by a program that has ended; it is stopped", device)
            Settings().put(device.folder / "buffer/enable", "0")
        setup = set_up(device, self._options, self._root, self._settings)
        self._settings.put(device.folder / "buffer/enable", "1")
        self.range_ms2, self._is_robot_time = setup.range_ms2, setup.is_robot_time
        period = 1 / self._options.rate_hz
        wraps = None if setup.stamps is None else math.inf
        self._timeline = Timeline(period, wraps, setup.tick, setup.is_robot_time)
        self._poll = select.poll()
        self._poll.register(self._fd, select.POLLIN)
        self._device, self._setup = device, setup

    def _take(self, device: IioDevice) -> int:
        """The character device, which the kernel gives to one process; the lock is for a file in its place."""
        try:
            fd = os.open(device.node, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
        except OSError as error:
            raise PortError(self._reason(device, error)) from error
        try:
            fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            os.close(fd)
            raise PortError(self._reason(device, OSError(errno.EBUSY, "locked"))) from error
        return fd

    def _receive(self, timeout_ms: float) -> bytes:
        """Whole frames, none when none came in time.  Raises PortError when the device is closed or gone."""
        if self._fd < 0 or self._setup is None or self._device is None:
            raise PortError(f"IIO device {self._options.device!r} is not open")
        size = self._setup.format.size
        try:
            if timeout_ms and not self._poll.poll(timeout_ms):
                return b""
            data = os.read(self._fd, FRAMES * size)
        except BlockingIOError:
            return b""
        except OSError as error:
            raise PortError(self._reason(self._device, error)) from error
        if not data:  # a kernel's device raises ENODEV
            raise PortError(self._reason(self._device, OSError(errno.ENODEV, "end of file")))
        data = self._rest + data
        end = len(data) // size * size
        self._rest = data[end:]
        return data[:end]

    def _reason(self, device: IioDevice, error: OSError) -> str:
        """The likely cause; for a busy device, which process has it."""
        others = holders(str(device.node)) if error.errno == errno.EBUSY else []
        return f"{device}: {refusal(device.node, error)}" + (f": process {', '.join(others)}" if others else "")

    def _listen(self) -> tuple[int, float]:
        """Number of samples after the first block, and the time they took [s]."""
        start = self._clock.now()
        first = last = None
        count = 0
        while (now := self._clock.now()) < (start + SILENCE_S if first is None else first + LISTEN_S):
            times = self.read().time
            if not len(times):
                continue
            now = float(times[-1])
            first, count, last = (now, 1, None) if first is None else (first, count + len(times), now)
        return (count, last - first) if first is not None and last is not None else (0, 0.0)


def _make(options: AccelerometerOptions, robot: RobotOptions, clock: Clock) -> Accelerometer:
    assert isinstance(options, IioOptions)
    if options.port:
        raise DriverError(
            f"accelerometer {options.name}: found port {options.port!r}, expected device: iio has no port"
        )
    check_rate(options)
    return IioAccelerometer(options, clock)


DRIVER = Driver(
    name="iio",
    summary="accelerometer of the Linux kernel (ADXL345, LIS3DH, MPU6050, …) through its IIO buffer",
    accelerometer=_make,
    accelerometer_options=IioOptions,
)
