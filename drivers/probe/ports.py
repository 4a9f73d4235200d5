"""Which serial ports there are: the adapter, the name that stays, and who has it open.  No port is opened here."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from serial.tools import list_ports
from serial.tools.list_ports_common import ListPortInfo

from lostmotion.drivers.holders import holders

__all__ = ["SerialPlace", "place", "places"]

BY_ID = Path("/dev/serial/by-id")


@dataclass(frozen=True, slots=True)
class SerialPlace:
    """One serial port.

    path: as Linux calls it today; stays: a name that survives replugging, ``path`` where there is none; adapter: the
    name that the plug reports; usb: whether it is USB, not on the board; users: the processes that have it open.
    """

    path: str
    stays: str
    adapter: str
    usb: bool
    users: tuple[str, ...]


def places() -> list[SerialPlace]:
    """All serial ports of this computer, by their paths."""
    return [_place(port.device, port) for port in sorted(list_ports.comports(), key=lambda port: port.device)]


def place(path: str) -> SerialPlace:
    """A port that somebody has named, whether or not the list has it; the name given is one that stays."""
    real = str(Path(path).resolve())
    listed = next((port for port in list_ports.comports() if port.device == real), None)
    found = _place(real, listed)
    named = path if path != real else found.stays
    return SerialPlace(real, named, found.adapter, found.usb, found.users)


def _place(path: str, port: ListPortInfo | None) -> SerialPlace:
    usb = port is not None and port.vid is not None
    maker = [text for text in (port.manufacturer, port.product) if text] if port is not None and usb else []
    if port is not None and usb:
        maker.append(f"({port.vid:04x}:{port.pid:04x})")
    return SerialPlace(path, _stays(path), " ".join(maker) or "no USB adapter", usb, tuple(holders(path)))


def _stays(path: str) -> str:
    with suppress(OSError):
        for link in sorted(BY_ID.iterdir()):
            if str(link.resolve()) == path:
                return str(link)
    return path
