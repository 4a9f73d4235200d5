"""IIO devices of the Linux kernel in sysfs: finding them, reading and setting attributes, putting settings back.

Attributes only; samples come through ``iio.py``.  Not pylibiio: it needs the C library libiio, which no wheel brings
and which robots' images lack, for what are a dozen small text files here.
"""

from __future__ import annotations

import contextlib
import errno
import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from lostmotion.drivers.errors import DriverError, PortError

__all__ = ["IioDevice", "Settings", "find_device", "refusal", "triggers"]

DEVICES = "sys/bus/iio/devices"
MODULES = "expected the kernel's driver of the sensor bound to it (a device tree overlay, or modprobe)"
UDEV = (
    "expected write access; likely cause: no udev rule for iio (lostmotion service install writes one: group dialout)"
)


@dataclass(frozen=True, slots=True)
class IioDevice:
    """One device: its folder in sysfs, its character device, and what it calls itself."""

    folder: Path
    node: Path
    name: str
    label: str

    def __str__(self) -> str:
        return f"{self.name} ({self.folder.name}{f', label {self.label}' if self.label else ''})"

    def read(self, *attributes: str) -> str | None:
        """The first of these attributes that there is; None if none is.  Raises PortError."""
        for attribute in attributes:
            try:
                return (self.folder / attribute).read_text().strip()
            except FileNotFoundError:
                continue
            except (OSError, ValueError) as error:
                raise PortError(f"{self}: {attribute} cannot be read: {error}") from error
        return None

    def has(self, attribute: str) -> bool:
        """Whether there is such an attribute."""
        return (self.folder / attribute).exists()


class Settings:
    """Attributes that were changed, with what stood there before."""

    def __init__(self) -> None:
        self._before: list[tuple[Path, str]] = []

    def put(self, path: Path, value: str) -> None:
        """Writes a value where another one stands.  Raises PortError with the likely cause."""
        try:
            before = path.read_text().strip()
            if before == value or _is_same_number(before, value):
                return
            _write(path, value)
        except OSError as error:
            raise PortError(refusal(path, error)) from error
        self._before.append((path, before))

    def put_if_allowed(self, path: Path, value: str) -> None:
        """The same for what is better so, but works as it is."""
        with contextlib.suppress(PortError):
            self.put(path, value)

    def restore(self) -> None:
        """Puts back what stood there, the last change first; a device that went away keeps nothing."""
        while self._before:
            path, before = self._before.pop()
            with contextlib.suppress(OSError):
                _write(path, before)


def find_device(root: Path, wanted: str) -> IioDevice:
    """The device of that name, label, or index (``iio:device0``, ``0``).  Raises PortError, and DriverError when
    several are called so."""
    devices = list(_devices(root))
    found = [device for device in devices if device.folder.name in (wanted, f"iio:device{wanted}")]
    found = found or [device for device in devices if wanted and device.label == wanted]
    found = found or [device for device in devices if device.name == wanted]
    if not found:
        there = f"there is {', '.join(map(str, devices))}" if devices else f"there is none in /{DEVICES}"
        raise PortError(f"IIO device {wanted!r} does not exist ({there}); {MODULES}")
    if len(found) > 1:
        raise DriverError(
            f"found {', '.join(map(str, found))}, expected one device {wanted!r}; name its label or index"
        )
    return found[0]


def triggers(root: Path) -> dict[str, Path]:
    """The folders of all triggers by their names."""
    folders = sorted((root / DEVICES).glob("trigger[0-9]*"))
    return {_text(folder / "name"): folder for folder in folders if (folder / "name").exists()}


def refusal(path: Path, error: OSError) -> str:
    """One line: what could not be used, and the likely cause."""
    if error.errno in (errno.EACCES, errno.EPERM, errno.EROFS):
        return f"{path} may not be used by this user ({error.strerror}); {UDEV}"
    if error.errno == errno.EBUSY:
        return (
            f"{path} is busy; likely cause: another program reads this sensor's buffer (iiod, a desktop's sensor proxy)"
        )
    if error.errno in (errno.ENODEV, errno.ENOENT, errno.EIO, errno.ENXIO):
        return (
            f"{path} went away ({error.strerror}); likely cause: the sensor was unplugged, or its kernel module removed"
        )
    return f"{path} was refused by the kernel's driver: {error.strerror or error}"


def _devices(root: Path) -> Iterator[IioDevice]:
    for folder in sorted((root / DEVICES).glob("iio:device[0-9]*"), key=lambda folder: int(folder.name[10:])):
        label = _text(folder / "label") if (folder / "label").exists() else ""
        yield IioDevice(folder, root / "dev" / folder.name, _text(folder / "name"), label)


def _text(path: Path) -> str:
    try:
        return path.read_text().strip()
    except (OSError, ValueError):
        return ""


def _write(path: Path, value: str) -> None:
    """In one call as sysfs wants it, never into a new file; an empty value is a line end: empty writes are ignored."""
    fd = os.open(path, os.O_WRONLY | os.O_TRUNC)
    try:
        os.write(fd, (value or "\n").encode())
    finally:
        os.close(fd)


def _is_same_number(before: str, value: str) -> bool:
    try:
        return float(before) == float(value)
    except ValueError:
        return False
