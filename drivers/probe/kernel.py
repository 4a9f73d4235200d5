"""What the kernel knows, from sysfs: CAN interfaces, accelerometers of its IIO subsystem.  Nothing is sent."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import time
from collections import Counter
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from lostmotion.drivers.can_bus import NET, kernel_interfaces
from lostmotion.drivers.codec.cia301 import HEARTBEAT, NODE_IDS, SYNC

__all__ = ["CanFound", "IioFound", "can_interfaces", "iio_accelerometers", "nodes"]

IIO = Path("/sys/bus/iio/devices")
IFF_UP = 1
LISTEN_S = 2.0
"""nodes' heartbeats come once a second, mostly"""


@dataclass(frozen=True, slots=True)
class CanFound:
    """A CAN interface; bitrate [bit/s] 0 where it is unknown; frames: received in ``LISTEN_S``; nodes: CANopen nodes
    with a heartbeat; sync_hz: SYNC objects a second; error: why nobody listened."""

    name: str
    up: bool
    bitrate: int
    frames: int = 0
    nodes: tuple[int, ...] = ()
    sync_hz: float = 0.0
    error: str = ""


@dataclass(frozen=True, slots=True)
class IioFound:
    """An accelerometer with a driver of the kernel's; device: its name in sysfs; name: the chip's."""

    device: str
    name: str


def iio_accelerometers(folder: Path = IIO) -> list[IioFound]:
    """All devices with an acceleration channel."""
    devices = sorted(folder.glob("iio:device*"))
    return [
        IioFound(device.name, _text(device / "name"))
        for device in devices
        if any(device.glob("in_accel_*")) or any(device.glob("scan_elements/in_accel_*"))
    ]


def can_interfaces(folder: Path = NET) -> list[CanFound]:
    """All CAN interfaces; those that are up are listened to."""
    return [_can(folder / name) for name in kernel_interfaces(folder)]


def nodes(ids: Iterable[int]) -> tuple[int, ...]:
    """The CANopen nodes whose heartbeat or boot-up is among these identifiers (CiA 301)."""
    return tuple(sorted({id - HEARTBEAT for id in ids} & {*NODE_IDS}))


def _can(device: Path) -> CanFound:
    name, up = device.name, bool(int(_text(device / "flags") or "0", 16) & IFF_UP)
    bitrate = _bitrate(name)
    if not up:
        return CanFound(name, up, bitrate, error=f"down; sudo ip link set {name} up type can bitrate 500000")
    try:
        counts = _listen(name)
    except (OSError, ImportError) as error:
        return CanFound(name, up, bitrate, error=f"cannot be listened to: {error}")
    return CanFound(name, up, bitrate, sum(counts.values()), nodes(counts), counts[SYNC] / LISTEN_S)


def _listen(name: str) -> Counter[int]:
    """How many data frames of each identifier come in; a raw socket of its own receives all and sends nothing."""
    from lostmotion.drivers.python_can import can

    found, end = Counter[int](), time.monotonic() + LISTEN_S
    try:
        with can.Bus(name, interface="socketcan") as bus:
            while (left := end - time.monotonic()) > 0:
                message = bus.recv(left)
                if message and not (message.is_error_frame or message.is_remote_frame or message.is_extended_id):
                    found[message.arbitration_id] += 1
    except can.CanError as error:
        raise OSError(str(error)) from error
    return found


def _bitrate(name: str) -> int:
    """The bit rate from the tool ``ip``; the kernel reports it over netlink only."""
    if shutil.which("ip") is None:
        return 0
    result = subprocess.run(
        ["ip", "-details", "-json", "link", "show", "dev", name], capture_output=True, text=True, check=False
    )
    with suppress(ValueError, LookupError, TypeError, AttributeError):
        timing = json.loads(result.stdout)[0]["linkinfo"]["info_data"]["bittiming"]
        return int(re.sub(r"\D", "", str(timing["bitrate"])))
    return 0


def _text(path: Path) -> str:
    with suppress(OSError):
        return path.read_text(errors="replace").strip()
    return ""
