"""An accelerometer as the Linux kernel shows it: sysfs as a tree of files, the character device as a FIFO.

Files cannot refuse a value as a kernel's driver does, and are polled: what is written to
``buffer/enable`` counts some milliseconds later.
"""

from __future__ import annotations

import contextlib
import os
import shutil
import struct
import threading
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from lostmotion.drivers.emulator.motion import Motion

__all__ = ["IioEmulator", "IioSensor"]

STEP_S = 0.004
ELEMENTS = ("in_accel_x", "in_accel_y", "in_accel_z", "in_temp", "in_timestamp")
SCALE = 1e-4
CODES = {8: "b", 16: "h", 32: "i", 64: "q"}


@dataclass
class IioSensor:
    """What is emulated.  type: of the three axes; files: sysfs attributes beside the usual ones, "" takes one away;
    dead: no sample ever comes; skip: samples to lose next.
    """

    motion: Motion
    rate_hz: float = 1000.0
    name: str = "adxl355"
    type: str = "be:s20/32>>12"
    axis: str = "x"
    dead: bool = False
    skip: int = 0
    files: Mapping[str, str] = field(default_factory=dict)


class IioEmulator:
    """Keeps the sensor below ``root`` until the ``with`` block ends."""

    def __init__(self, sensor: IioSensor, root: Path) -> None:
        self.sensor = sensor
        self.root = root
        self.folder = root / "sys/bus/iio/devices/iio:device0"
        self.node = root / "dev/iio:device0"
        self.paths = (str(root),)
        self._tip = [round(value / SCALE) for value in sensor.motion.tip(sensor.rate_hz)]
        self._stop = threading.Event()
        self._held = threading.Lock()
        self._fd = -1
        self._next = -1
        self._thread = threading.Thread(target=self._serve, name="emulated iio", daemon=True)

    def __enter__(self) -> IioEmulator:
        self.plug()
        self._thread.start()
        return self

    def __exit__(self, *error: object) -> None:
        self._stop.set()
        self._thread.join()
        self.unplug()

    def plug(self) -> None:
        """The kernel's driver finds the sensor."""
        trigger = self.folder.parent / "trigger0"
        self.node.parent.mkdir(parents=True, exist_ok=True)
        os.mkfifo(self.node)
        self._fd = os.open(self.node, os.O_RDWR | os.O_NONBLOCK)  # so that a reader waits, as at a device
        files = {
            "name": self.sensor.name,
            "in_accel_scale": f"{SCALE:.9f}",
            "in_accel_x_offset": "0",
            "sampling_frequency": "125",
            "sampling_frequency_available": "4000 2000 1000 500 250 125 62.5",
            "current_timestamp_clock": "realtime",
            "trigger/current_trigger": "",
            "buffer/enable": "0",
            "buffer/length": "2",
            "buffer/watermark": "1",
        }
        for index, element in enumerate(ELEMENTS):
            files[f"scan_elements/{element}_index"] = str(index)
            files[f"scan_elements/{element}_en"] = str(int(element == "in_temp"))
            files[f"scan_elements/{element}_type"] = self.sensor.type
        files["scan_elements/in_temp_type"] = "le:u12/16>>0"
        files["scan_elements/in_timestamp_type"] = "le:s64/64>>0"
        for name, text in (files | dict(self.sensor.files)).items():
            if text or name not in self.sensor.files:
                _put(self.folder / name, text)
        _put(trigger / "name", f"{self.sensor.name}-dev0")

    def unplug(self) -> None:
        """The device is gone: whoever reads gets an error."""
        with self._held:
            self._hang_up()
            shutil.rmtree(self.folder, ignore_errors=True)
            self.node.unlink(missing_ok=True)

    def now(self, attribute: str) -> str:
        """What an attribute holds."""
        try:
            return (self.folder / attribute).read_text().strip()
        except FileNotFoundError:
            return ""

    def _serve(self) -> None:
        while not self._stop.wait(STEP_S):
            with self._held:
                if self.now("buffer/enable") != "1":
                    self._empty()
                elif not self.sensor.dead:
                    self._send()

    def _empty(self) -> None:
        """A buffer that is off keeps nothing; the next sample is one that is measured after it was started."""
        self._next = -1
        with contextlib.suppress(OSError):
            while self._fd >= 0 and os.read(self._fd, 65536):
                pass

    def _hang_up(self) -> None:
        fd, self._fd = self._fd, -1
        if fd >= 0:
            os.close(fd)

    def _send(self) -> None:
        """All samples up to now; sample i is measured at i / rate on the monotonic clock."""
        end = int(time.monotonic() * self.sensor.rate_hz)
        self._next, self.sensor.skip = (self._next if self._next >= 0 else end) + self.sensor.skip, 0
        enabled = [name for name in ELEMENTS if self.now(f"scan_elements/{name}_en") == "1"]
        types = {name: self.now(f"scan_elements/{name}_type") for name in enabled}
        offset = _offset_ns() if self.now("current_timestamp_clock") == "realtime" else 0
        data = b"".join(self._frame(index, types, offset) for index in range(self._next, end))
        self._next = max(self._next, end)
        with contextlib.suppress(BlockingIOError):  # the reader is late, and the kernel's buffer full
            os.write(self._fd, data)

    def _frame(self, index: int, types: Mapping[str, str], clock_ns: int) -> bytes:
        frame, largest = b"", 1
        for name, text in types.items():
            order, rest = text.split(":")
            bits, storage = map(int, rest[1:].partition(">>")[0].split("/"))
            limit = 1 << bits - 1
            value = max(-limit, min(limit - 1, self._value(name, index, clock_ns))) << int(text.partition(">>")[2])
            frame += bytes(-len(frame) % (storage // 8))
            frame += struct.pack((">" if order == "be" else "<") + CODES[storage], value)
            largest = max(largest, storage // 8)
        return frame + bytes(-len(frame) % largest)

    def _value(self, name: str, index: int, clock_ns: int) -> int:
        if name == "in_timestamp":
            return round(index / self.sensor.rate_hz * 1e9) + clock_ns
        return self._tip[index % len(self._tip)] if name == f"in_accel_{self.sensor.axis}" else 7


def _put(path: Path, text: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(f"{text}\n")


def _offset_ns() -> int:
    """Real time minus monotonic time.  A pause between the two questions makes it too small, so the largest counts."""
    return max(time.time_ns() - time.monotonic_ns() for _ in range(5))
