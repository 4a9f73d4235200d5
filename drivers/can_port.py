"""Sharing of a CAN bus: any number of drivers of this process use one that is opened once.

The listener that reads first reads for all.  The bus itself is in ``can_bus.py``.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Collection
from typing import Protocol

from lostmotion.drivers.base import Port
from lostmotion.drivers.can_bus import BusOptions, CanBus, CanFrame, check_bus, open_can
from lostmotion.drivers.errors import PortError

__all__ = ["CanOptions", "CanPort"]

WAITING = 20_000
"""frames that wait for a listener that does not read; the oldest go first"""


class CanOptions(Protocol):
    """The keys of a device on a CAN bus.

    port: the channel, can0 or the serial adapter's path; interface: as python-can names it; bitrate [bit/s], which of
    socketcan is set with ``ip link``; options: what else the interface takes.
    """

    @property
    def name(self) -> str: ...
    @property
    def port(self) -> Port: ...
    @property
    def interface(self) -> str: ...
    @property
    def bitrate(self) -> int | None: ...
    @property
    def options(self) -> dict[str, str | int | float | bool]: ...


class _Shared:
    """A bus and its listeners."""

    def __init__(self, bus: CanBus) -> None:
        self.bus = bus
        self.listeners: list[CanPort] = []
        self.lock = threading.RLock()
        self.error: PortError | None = None

    def fetch(self, timeout_s: float) -> None:
        """Reads for all; one after the other."""
        if self.error:
            raise PortError(str(self.error))
        try:
            frames = self.bus.receive(timeout_s)
        except PortError as error:
            self.error = error
            raise
        broken, self.bus.broken = self.bus.broken, 0
        for listener in self.listeners:
            listener.deliver(frames, broken)

    def filter(self) -> None:
        """Lets in the frames that any listener wants."""
        wanted = [listener.ids for listener in self.listeners]
        self.bus.only(None if None in wanted else {id for ids in wanted if ids is not None for id in ids})


_open: dict[tuple[str, str], _Shared] = {}
_opening = threading.Lock()


class CanPort:
    """One listener.  broken: error frames, and lines that are none, since it was set to 0."""

    def __init__(self, options: CanOptions, now: Callable[[], float]) -> None:
        """Raises DriverError for an interface or a bit rate that cannot be."""
        check_bus(options.name, options.interface, options.bitrate)
        self.path = options.port
        self.broken = 0
        self.ids: frozenset[int] | None = None
        self._key = (options.interface, options.port)
        self._bitrate = options.bitrate
        self._options: BusOptions = options.options
        self._now = now
        self._shared: _Shared | None = None
        self._received: deque[CanFrame] = deque(maxlen=WAITING)

    def open(self) -> None:
        """Joins the listeners of the bus, or opens it.  Raises PortError."""
        self.close()
        with _opening:
            shared = _open.get(self._key)
            if shared is None or shared.error:
                shared = _open[self._key] = _Shared(open_can(*self._key, self._bitrate, self._options, self._now))
            with shared.lock:
                self._received.clear()
                shared.listeners.append(self)
                shared.filter()
            self._shared = shared

    def only(self, ids: Collection[int] | None) -> None:
        """From now on frames with these identifiers are received, or all."""
        self.ids = None if ids is None else frozenset(ids)
        if (shared := self._shared) is not None:
            with shared.lock:
                shared.filter()

    @property
    def stamped(self) -> bool:
        """Whether frames keep their time, however late they are read."""
        return self._shared is not None and self._shared.bus.stamped

    @property
    def foreign(self) -> bytes:
        """The first bytes of what is no adapter."""
        return self._shared.bus.foreign if self._shared else b""

    def foreign_words(self) -> tuple[str, str]:
        """The same as what an Identity has found, and without what differs between looks."""
        text = "{} that are no CAN frames; likely cause: another device on the port, or a wrong baudrate"
        return text.format(repr(self.foreign[:24])), text.format("bytes")

    def read(self, timeout_s: float) -> list[CanFrame]:
        """What has come in; waits up to ``timeout_s`` for it.  Raises PortError when the bus is closed or gone."""
        shared = self._joined()
        with shared.lock:
            if self._shared is None:  # closed while another one read
                raise self._closed()
            if not self._received or shared.bus.stamped:
                shared.fetch(0.0 if self._received else timeout_s)
            frames = list(self._received)
            self._received.clear()
        return frames

    def send(self, id: int, data: bytes) -> None:
        """Sends a frame.  Raises PortError."""
        shared = self._joined()
        with shared.lock:
            shared.bus.send(id, data)

    def deliver(self, frames: list[CanFrame], broken: int) -> None:
        """Takes frames that another listener has read."""
        self.broken += broken
        ids = self.ids
        self._received.extend(frames if ids is None else [frame for frame in frames if frame.id in ids])

    def close(self) -> None:
        """Leaves; the last one gives the bus back."""
        with _opening:
            shared, self._shared = self._shared, None
            if shared is None:
                return
            with shared.lock:
                shared.listeners.remove(self)
                if shared.listeners:
                    shared.filter()
                    return
                shared.bus.close()
            if _open.get(self._key) is shared:
                del _open[self._key]

    def _joined(self) -> _Shared:
        if self._shared is None:
            raise self._closed()
        return self._shared

    def _closed(self) -> PortError:
        return PortError(f"port {self.path} is not open")
