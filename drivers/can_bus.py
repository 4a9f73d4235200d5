"""A CAN bus as bytes with robot times: by python-can, or by a serial adapter (slcan).  What frames mean stands in
``codec``, who shares a bus in ``can_port.py``.
"""

from __future__ import annotations

import errno
import socket
import time
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple, Protocol

from lostmotion.drivers.codec import slcan
from lostmotion.drivers.errors import DriverError, PortError
from lostmotion.drivers.packages import is_there, missing
from lostmotion.drivers.serial_port import SerialPort

if TYPE_CHECKING:
    import can

__all__ = ["NET", "BusOptions", "CanBus", "CanFrame", "check_bus", "kernel_interfaces", "open_can"]

BusOptions = Mapping[str, str | int | float | bool]
SERIAL = "slcan"
SERIAL_BAUDRATE = 115200
"""of the adapter's port; one on USB takes any"""
AT_ONCE = 4096
KERNEL_BYTES = 1_000_000
"""asked for as the kernel's buffer, which grants less: 212 kB as shipped, some 270 frames"""
OLDEST_S = 1.0
"""an older stamp, or one of the future, is that of a clock of the adapter's own"""
ERROR_FRAME_BUS_OFF = 0x40
NET = Path("/sys/class/net")
ARPHRD_CAN = "280"


class CanFrame(NamedTuple):
    """A data frame: its identifier, its bytes, the robot time [s] at which it came."""

    id: int
    data: bytes
    time: float


class CanBus(Protocol):
    """A bus that is open.  stamped: frames keep their time, however late they are fetched; broken, foreign: error
    frames or lines since the last look, and the first bytes of another device."""

    stamped: bool
    broken: int

    @property
    def foreign(self) -> bytes: ...

    def receive(self, timeout_s: float) -> list[CanFrame]:
        """What has come in; waits up to ``timeout_s`` for it.  Raises PortError."""
        ...

    def send(self, id: int, data: bytes) -> None:
        """Sends a frame.  Raises PortError."""
        ...

    def only(self, ids: Iterable[int] | None) -> None:
        """Lets in frames of these identifiers, or all."""
        ...

    def close(self) -> None:
        """Gives the bus back."""
        ...


def check_bus(who: str, interface: str, bitrate: int | None) -> None:
    """Raises DriverError for an interface or a bit rate that cannot be."""
    if interface == SERIAL:
        if bitrate is not None and bitrate not in slcan.SPEEDS:
            known = ", ".join(map(str, sorted(slcan.SPEEDS)))
            raise DriverError(f"{who}: found bitrate {bitrate}, expected one that slcan adapters know: {known}")
        return
    if not is_there("can"):
        raise DriverError(f"{who}: {missing('can', 'CAN')}")
    from lostmotion.drivers.python_can import can

    if interface not in can.VALID_INTERFACES:
        known = ", ".join(sorted(can.VALID_INTERFACES))
        raise DriverError(f"{who}: found interface {interface!r}, expected one that python-can knows: {known}")


def open_can(
    interface: str, channel: str, bitrate: int | None, options: BusOptions, now: Callable[[], float]
) -> CanBus:
    """Opens a bus.  Raises PortError."""
    if interface == SERIAL:
        return SlcanBus(channel, bitrate, options, now)
    return LibraryBus(interface, channel, bitrate, options, now)


def kernel_interfaces(folder: Path = NET) -> list[str]:
    """The names of the CAN interfaces that the kernel knows."""
    found = []
    for path in sorted(folder.glob("*/type")):
        with suppress(OSError):  # it was unplugged meanwhile
            found += [path.parent.name] if path.read_text().strip() == ARPHRD_CAN else []
    return found


class SlcanBus:
    """A serial adapter.  What it sends has no time of its own: frames count from when they came in."""

    stamped = False

    def __init__(self, path: str, bitrate: int | None, options: BusOptions, now: Callable[[], float]) -> None:
        self._now = now
        self._port = SerialPort(path, int(options.get("baudrate", SERIAL_BAUDRATE)))
        self._decoder = slcan.SlcanDecoder()
        self._port.open()
        speed = b"" if bitrate is None else b"S%d\r" % slcan.SPEEDS[bitrate]
        self._port.write(slcan.CLOSE + speed + (b"L\r" if options.get("listen_only") else slcan.OPEN))

    @property
    def broken(self) -> int:
        return self._decoder.broken

    @broken.setter
    def broken(self, count: int) -> None:
        self._decoder.broken = count

    @property
    def foreign(self) -> bytes:
        return self._decoder.foreign

    def receive(self, timeout_s: float) -> list[CanFrame]:
        data = self._port.read(timeout_s)
        now = self._now()
        return [CanFrame(id, content, now) for id, content in self._decoder.feed(data)]

    def send(self, id: int, data: bytes) -> None:
        self._port.write(slcan.encode(id, data))

    def only(self, ids: Iterable[int] | None) -> None:
        """An adapter has no filter for that."""

    def close(self) -> None:
        with suppress(PortError):
            self._port.write(slcan.CLOSE)
        self._port.close()


class LibraryBus:
    """Any interface of python-can's.  The kernel's receive stamps (socketcan), which are UTC, become robot times by the
    age of the frame; stamps that are no UTC are not used."""

    stamped = True
    foreign = b""

    def __init__(
        self, interface: str, channel: str, bitrate: int | None, options: BusOptions, now: Callable[[], float]
    ) -> None:
        from lostmotion.drivers.python_can import FAULTS, can

        self.broken = 0
        self._now = now
        self._name = f"CAN {channel}"
        self._faults = FAULTS
        given = ({"bitrate": bitrate} if bitrate else {}) | dict(options)
        try:
            self._bus: can.BusABC = can.Bus(channel, interface=interface, **given)  # type: ignore[arg-type]
        except (*self._faults, ImportError) as error:
            raise PortError(_explain(channel, error)) from error
        kernel = getattr(self._bus, "socket", None)
        if isinstance(kernel, socket.socket):
            kernel.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, KERNEL_BYTES)

    def receive(self, timeout_s: float) -> list[CanFrame]:
        frames: list[CanFrame] = []
        recv = self._bus.recv
        try:
            message = recv(timeout_s)
            age = time.time() - self._now()  # of UTC beyond robot time
            oldest = time.time() - OLDEST_S
            while message is not None:
                stamp = message.timestamp
                if message.is_error_frame:
                    self._error(message.arbitration_id)
                elif not message.is_remote_frame:
                    moment = stamp - age if oldest < stamp else self._now()
                    frames.append(CanFrame(message.arbitration_id, bytes(message.data), min(moment, self._now())))
                if len(frames) >= AT_ONCE:
                    break
                message = recv(0.0)
        except self._faults as error:
            raise PortError(self._gone(error)) from error
        return frames

    def send(self, id: int, data: bytes) -> None:
        from lostmotion.drivers.python_can import can

        try:
            self._bus.send(can.Message(arbitration_id=id, data=data, is_extended_id=id > 0x7FF), timeout=0.1)
        except self._faults as error:
            raise PortError(self._gone(error)) from error

    def only(self, ids: Iterable[int] | None) -> None:
        with suppress(*self._faults):  # more comes in then
            if ids is None:
                self._bus.set_filters(None)
            else:
                self._bus.set_filters([{"can_id": id, "can_mask": 0x1FFFFFFF, "extended": id > 0x7FF} for id in ids])

    def close(self) -> None:
        with suppress(*self._faults):
            self._bus.shutdown()

    def _error(self, kind: int) -> None:
        self.broken += 1
        if kind & ERROR_FRAME_BUS_OFF:
            raise PortError(
                f"{self._name} went away: bus off; likely cause: a wrong bitrate, a broken wire, or no terminator"
            )

    def _gone(self, error: BaseException) -> str:
        number = getattr(error, "error_code", None) or getattr(error, "errno", None)
        if number == errno.ENETDOWN:
            return f"{self._name} is down; likely cause: ip link set {self._name[4:]} up was not done, or bus off"
        return f"{self._name} went away ({error}); likely cause: unplugged or lost power"


def _explain(channel: str, error: BaseException) -> str:
    """One line for a bus that does not open: what was found, what was expected, the likely cause."""
    number = getattr(error, "error_code", None) or getattr(error, "errno", None)
    if number == errno.ENODEV:
        there = ", ".join(kernel_interfaces()) or "no CAN interface"
        return f"CAN {channel} does not exist; likely cause: unplugged, or under another name (there is {there})"
    if number == errno.EAFNOSUPPORT:
        return f"CAN {channel} does not exist: this kernel has no CAN; likely cause: the module can_raw is missing"
    if number in (errno.EACCES, errno.EPERM):
        return f"CAN {channel} may not be opened by this user"
    return f"CAN {channel} does not open ({error}); likely cause: another interface or channel than the adapter's"
