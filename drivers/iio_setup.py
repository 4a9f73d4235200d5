"""The settings of an IIO device for a measurement, and the resulting format of its samples: elements of the scan, rate,
trigger, buffer and clock.  Every change goes through ``Settings``, which puts it back.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from lostmotion.drivers.base import FloatArray
from lostmotion.drivers.codec.iio_scan import ScanError, ScanFormat, ScanType
from lostmotion.drivers.errors import DriverError, PortError
from lostmotion.drivers.iio_sysfs import IioDevice, Settings, triggers

if TYPE_CHECKING:
    from lostmotion.drivers.iio import IioOptions

__all__ = ["Part", "Setup", "set_up"]

TIMESTAMP = "in_timestamp"
RATE = ("in_accel_sampling_frequency", "sampling_frequency", "in_sampling_frequency")
COARSE_CLOCKS = {
    "monotonic_coarse": 6,  # of linux/time.h; Python names neither this one nor the next
    "realtime_coarse": 5,
}
ROBOT_CLOCKS = ("monotonic", "monotonic_coarse")
"""what the kernel stamps by is the clock of ``SystemClock``"""
NANO = 1e-9
NEAR = 0.01
"""of the rate: 800 is 781.25 for no sensor, but 99.9 is 100"""
LENGTH_S, WATERMARK_S = 2.0, 0.02
LEAST_LENGTH = 128
"""samples that the kernel keeps for a reader that is late"""
HRTIMER = (
    "sudo modprobe iio-trig-hrtimer && sudo mkdir /sys/kernel/config/iio/triggers/hrtimer/lostmotion, then "
    'trigger = "lostmotion"'
)


@dataclass(frozen=True, slots=True)
class Part:
    """One element's share in the acceleration: (number + offset) × scale [m/s²]."""

    element: str
    offset: float
    scale: float


@dataclass(frozen=True, slots=True)
class Setup:
    """What is known of a device that is set up.

    stamps: the element that is the time, None where the driver has none; is_robot_time: whether its clock is that of
    the robot; tick: in which steps it goes on [s]; range_ms2: the largest acceleration that the numbers can hold.
    """

    format: ScanFormat
    parts: tuple[Part, ...]
    stamps: str | None
    is_robot_time: bool
    tick: float
    range_ms2: float

    def samples(self, frames: bytes) -> tuple[FloatArray, FloatArray | None]:
        """The accelerations [m/s²] of whole frames, and their times [s] on the device's clock if it has one."""
        numbers = self.format.decode(frames)
        accel = np.zeros(len(frames) // self.format.size)
        for part in self.parts:
            accel += (numbers[part.element] + part.offset) * part.scale
        return accel, None if self.stamps is None else np.asarray(numbers[self.stamps] * NANO, np.float64)


def set_up(device: IioDevice, options: IioOptions, root: Path, settings: Settings) -> Setup:
    """Sets the device up; its buffer is still off.  Raises DriverError for what it cannot do, PortError for what it may
    not, or cannot now."""
    parts = tuple(_parts(device, options.axis))
    elements = _enable(device, [part.element for part in parts], settings)
    trigger = _trigger(device, options.trigger, root, settings)
    _set_rate(device, options, trigger, settings)
    length = max(LEAST_LENGTH, round(LENGTH_S * options.rate_hz))
    settings.put_if_allowed(device.folder / "buffer/length", str(length))
    settings.put_if_allowed(device.folder / "buffer/watermark", str(max(1, round(WATERMARK_S * options.rate_hz))))
    stamps = TIMESTAMP if TIMESTAMP in elements else None
    settings.put_if_allowed(device.folder / "current_timestamp_clock", "monotonic")
    clock = device.read("current_timestamp_clock") or "realtime"
    tick = time.clock_getres(COARSE_CLOCKS[clock]) if clock in COARSE_CLOCKS else 0.0
    reach = sum(
        max(abs(limit + part.offset) for limit in elements[part.element].limits) * abs(part.scale) for part in parts
    )
    return Setup(ScanFormat(elements), parts, stamps, stamps is not None and clock in ROBOT_CLOCKS, tick, reach)


def _parts(device: IioDevice, axis: str) -> Iterator[Part]:
    """The elements whose sum is the acceleration along an axis of the mounted sensor."""
    sign = -1.0 if axis.startswith("-") else 1.0
    row = _mount_matrix(device)["xyz".index(axis[-1])]
    for own, share in zip("xyz", row, strict=True):
        if not share:
            continue
        element = f"in_accel_{own}"
        if not device.has(f"scan_elements/{element}_en"):
            raise DriverError(
                f"{device}: found no scan_elements/{element}_en, expected an accelerometer with axis {own}"
            )
        scale, offset = (
            _number(device, default, f"{element}_{what}", f"in_accel_{what}", f"in_{what}")
            for what, default in (("scale", 1.0), ("offset", 0.0))
        )
        yield Part(element, offset, sign * share * scale)


def _mount_matrix(device: IioDevice) -> list[list[float]]:
    """How the sensor is mounted, row by row; the identity where it has none."""
    text = device.read("in_accel_mount_matrix", "in_mount_matrix", "mount_matrix") or "1, 0, 0; 0, 1, 0; 0, 0, 1"
    try:
        rows = [[float(number) for number in row.split(",")] for row in text.split(";")]
    except ValueError:
        rows = []
    if [len(row) for row in rows] != [3, 3, 3] or not all(any(row) for row in rows):
        raise DriverError(f"{device}: found mount matrix {text!r}, expected three rows of three numbers")
    return rows


def _enable(device: IioDevice, wanted: list[str], settings: Settings) -> dict[str, ScanType]:
    """Puts these elements and the time into the scan, and all others out of it; their types in the scan's order."""
    folder = device.folder / "scan_elements"
    there = [path.name.removesuffix("_en") for path in sorted(folder.glob("*_en"))]
    for name in there:
        settings.put(folder / f"{name}_en", str(int(name in wanted or name == TIMESTAMP)))
    enabled = [name for name in there if device.read(f"scan_elements/{name}_en") == "1"]
    try:
        enabled.sort(key=lambda name: int(device.read(f"scan_elements/{name}_index") or ""))
        return {name: ScanType.parse(device.read(f"scan_elements/{name}_type") or "") for name in enabled}
    except ScanError as error:
        raise DriverError(f"{device}: {error}") from error
    except ValueError as error:
        raise DriverError(f"{device}: found no number in scan_elements/*_index: {error}") from error


def _trigger(device: IioDevice, wanted: str, root: Path, settings: Settings) -> Path | None:
    """The folder of the trigger that paces the device, None for one that needs none."""
    attribute, there = device.folder / "trigger/current_trigger", triggers(root)
    names = ", ".join(there) or "none"
    if not attribute.exists():
        if wanted:
            raise DriverError(f"{device}: found trigger {wanted!r}, expected none: this sensor paces itself")
        return None
    if wanted and wanted not in there:
        raise PortError(f"{device}: there is no trigger {wanted!r} (there is {names}); to make one: {HRTIMER}")
    own = (f"{device.name}-dev{device.folder.name[10:]}", f"{device.name}-trigger")
    current = (device.read("trigger/current_trigger") or "",)
    name = wanted or next((name for name in (*current, *own) if name in there), "")
    if not name and device.has("buffer/hwfifo_enabled"):
        return None
    if not name:
        raise PortError(
            f"{device} has no trigger of its own (there is {names}); expected its interrupt line in the device tree, "
            f"or a timer: {HRTIMER}"
        )
    settings.put(attribute, name)
    return there[name]


def _set_rate(device: IioDevice, options: IioOptions, trigger: Path | None, settings: Settings) -> None:
    """A timer has any rate, and the sensor then one that is no slower; else the sensor's own rate is what counts."""
    wanted = options.rate_hz
    attribute = next((name for name in RATE if device.has(name)), None)
    timer = trigger / "sampling_frequency" if trigger is not None else None
    if timer is not None and timer.exists():
        settings.put(timer, f"{wanted:g}")
        faster = [rate for rate in _rates(device) if rate >= wanted * (1 - NEAR)]
        if attribute is not None and faster:
            settings.put(device.folder / attribute, f"{min(faster):.9g}")
        return
    if attribute is None:
        return  # a rate that cannot be set: identify measures it
    offered = sorted(_rates(device), key=lambda rate: abs(rate - wanted))
    if offered and abs(offered[0] - wanted) > NEAR * wanted:
        some = ", ".join(f"{rate:g}" for rate in sorted(offered[:4]))
        raise DriverError(
            f"accelerometer {options.name}: rate_hz is {wanted:g}; {device} offers {offered[0]:g} next to it, and of "
            f"those near {some}"
        )
    settings.put(device.folder / attribute, f"{offered[0] if offered else wanted:.9g}")
    now = _number(device, wanted, attribute)
    if abs(now - wanted) > NEAR * wanted:
        raise DriverError(f"accelerometer {options.name}: rate_hz is {wanted:g}; {device} made {now:g} of it")


def _rates(device: IioDevice) -> list[float]:
    """The rates that a device offers [Hz]: a list, or a range of which the nearest is taken by the device itself."""
    text = device.read(*(f"{name}_available" for name in RATE)) or ""
    if text.startswith("["):
        return []
    try:
        return [float(rate) for rate in text.split()]
    except ValueError:
        return []


def _number(device: IioDevice, default: float, *attributes: str) -> float:
    text = device.read(*attributes)
    try:
        return default if text is None else float(text)
    except ValueError as error:
        raise DriverError(f"{device}: found {text!r} as {attributes[0]}, expected a number") from error
