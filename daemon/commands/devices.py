"""The devices of a configuration for one short measurement, without the service.

Hardware is read by one thread for each device, a virtual robot's devices in turn.  Nothing is tried again here: what
goes wrong is an event for the caller.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from queue import Empty, Full, Queue
from types import TracebackType
from typing import Self

from lostmotion.daemon.config import Config
from lostmotion.drivers.base import AccelBlock, Accelerometer, Identity, ServoBus, ServoReading
from lostmotion.drivers.clock import Clock, SystemClock
from lostmotion.drivers.errors import DriverError, EndOfData

__all__ = ["Device", "Devices", "Event"]

WAIT_S = 0.1
GRACE_S = 0.5
"""How long after its end a measurement waits for samples of that time [s]."""
WAITING = 200
"""Events that may wait to be taken; nobody gets that far behind."""
GIVE_UP_S = 5.0
"""How long a thread may take to end after its port was closed [s]."""


@dataclass(frozen=True, slots=True)
class Device:
    """A servo bus or an accelerometer; members: the joints, or the accelerometer, behind it."""

    name: str
    members: tuple[str, ...]
    port: ServoBus | Accelerometer


@dataclass(frozen=True, slots=True)
class Event:
    """Something a device said: who it is, what it measured, and at the end, if it came to one, what went wrong."""

    device: Device
    identities: tuple[Identity, ...] = ()
    data: ServoReading | AccelBlock | None = None
    ended: bool = False
    error: DriverError | None = None

    @property
    def newest(self) -> float:
        """Robot time [s] of the last sample, -inf without any."""
        if isinstance(self.data, AccelBlock):
            return float(self.data.time[-1]) if len(self.data.time) else -math.inf
        return self.data.samples[-1].time if self.data and self.data.samples else -math.inf


@dataclass(slots=True)
class Devices:
    """All devices of a configuration; a context manager that reads them from its beginning to its end."""

    config: Config
    clock: Clock = field(init=False)
    all: list[Device] = field(init=False)
    _waits: bool = field(init=False)
    _events: Queue[Event] = field(init=False)
    _stop: threading.Event = field(init=False)
    _threads: list[threading.Thread] = field(init=False)

    def __post_init__(self) -> None:
        config = self.config
        driver = next(iter(config.drivers.values()))  # a virtual robot has one driver, all hardware has one clock
        self.clock = driver.clock(config.robots[driver.name]) if driver.clock else SystemClock()
        self._waits = driver.waits
        self.all = [*self._buses(), *self._accelerometers()]
        self._events = Queue(WAITING)
        self._stop = threading.Event()
        threaded = () if self._waits else self.all
        self._threads = [threading.Thread(target=self._read, args=(device,), daemon=True) for device in threaded]

    def __enter__(self) -> Self:
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stop.set()
        for device in self.all:
            device.port.close()
        for thread in self._threads:
            thread.join(GIVE_UP_S)

    def events(self, duration_s: float) -> Iterator[Event]:
        """What the devices say in ``duration_s`` seconds of robot time from now, and a little beyond it.

        Each device has to get there; hardware that is silent then is not waited for.
        """
        until = self.clock.now() + duration_s
        behind = {device.name for device in self.all}
        for event in self._in_turn() if self._waits else self._from_threads(until + GRACE_S):
            if event.ended or event.newest >= until:
                behind.discard(event.device.name)
            yield event
            if not behind:
                return

    def _from_threads(self, until: float) -> Iterator[Event]:
        while self.clock.now() < until:
            with suppress(Empty):
                yield self._events.get(timeout=WAIT_S)

    def _in_turn(self) -> Iterator[Event]:
        """A virtual robot's devices, always the one that is furthest behind: none gets far ahead of the others."""
        telling = {device.name: self._told(device) for device in self.all}
        newest = dict.fromkeys(telling, -math.inf)
        while telling:
            name = min(telling, key=newest.__getitem__)
            for event in telling[name]:
                newest[name] = max(newest[name], event.newest)
                yield event
                break
            else:
                del telling[name]

    def _buses(self) -> Iterator[Device]:
        for joints in self.config.buses():
            driver = self.config.drivers[joints[0].driver]
            assert driver.servo is not None  # the configuration was checked
            bus = driver.servo(joints, self.config.robots[driver.name], self.clock)
            names = tuple(joint.name for joint in joints)
            yield Device(f"{driver.name} {joints[0].port or ', '.join(names)}", names, bus)

    def _accelerometers(self) -> Iterator[Device]:
        for options in self.config.accelerometers:
            driver = self.config.drivers[options.driver]
            assert driver.accelerometer is not None  # the configuration was checked
            sensor = driver.accelerometer(options, self.config.robots[driver.name], self.clock)
            yield Device(f"{driver.name} {options.port or options.name}", (options.name,), sensor)

    def _told(self, device: Device) -> Iterator[Event]:
        """All that a device says in its life."""
        try:
            device.port.open()
            yield Event(device, identities=device.port.identify())
            while not self._stop.is_set():
                yield Event(device, data=device.port.read())
        except EndOfData:
            yield Event(device, ended=True)
        except DriverError as error:
            yield Event(device, ended=True, error=error)
        finally:
            device.port.close()

    def _read(self, device: Device) -> None:
        """A thread's work.  Hardware that finds the queue full, its reader being stuck, waits for it."""
        for event in self._told(device):
            while not self._stop.is_set():
                with suppress(Full):
                    self._events.put(event, timeout=WAIT_S)
                    break
