"""The devices of a configuration for one short measurement, without the service.

Hardware is read by one thread for each device, a virtual robot's devices in turn.  Nothing is tried again here: what
goes wrong is an event for the caller.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from queue import Empty, Full, Queue
from typing import Self

from lostmotion.daemon.config import Config
from lostmotion.drivers.base import AccelBlock, Accelerometer, Identity, ServoBus, ServoReading
from lostmotion.drivers.errors import DriverError, EndOfData

__all__ = ["Device", "Devices", "Event"]

WAIT_S = 0.1
GATHER_S = 0.01
"""For so long a thread leaves an accelerometer alone after each reading [s]: ten samples cost little more than one."""
GRACE_S = 0.5
"""How long after its end a measurement waits for samples of that time [s]."""
WAITING = 200
"""Events that may wait to be taken; more than ever wait in practice."""
GIVE_UP_S = 5.0
"""How long a thread may take to end after its port was closed [s]."""


@dataclass(frozen=True, slots=True)
class Device:
    """A servo bus or an accelerometer.  name: unique within the robot; members: the joints, or the accelerometer."""

    name: str
    members: tuple[str, ...]
    port: ServoBus | Accelerometer


@dataclass(frozen=True, slots=True)
class Event:
    """A report of a device: its identities, its data, and at the end, if it failed, the error."""

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


class Devices:
    """All devices of a configuration; a context manager that reads them from its beginning to its end.

    First ask for ``identities``, then for ``events``.
    """

    def __init__(self, config: Config) -> None:
        self._config = config
        self.clock = config.make_clock()
        self.all = [*self._buses(), *self._accelerometers()]
        self._going = {device.name for device in self.all}
        self._streams = {device.name: self._stream(device) for device in self.all}
        self._stop = threading.Event()
        self._events: Queue[Event] = Queue(WAITING)
        threaded = () if config.is_virtual else self.all
        self._threads = [threading.Thread(target=self._read, args=(device,), daemon=True) for device in threaded]

    def __enter__(self) -> Self:
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(self, *error: object) -> None:
        self._stop.set()
        for device in self.all:
            device.port.close()
        for thread in self._threads:
            thread.join(GIVE_UP_S)

    def identities(self) -> list[Event]:
        """Who the devices are, once each has answered or failed; hardware's samples until then are not kept."""
        answers = []
        if self._config.is_virtual:
            answers = [next(stream) for stream in self._streams.values()]
        while {event.device.name for event in answers} < self._streams.keys():
            event = self._events.get()
            if event.data is None:
                answers.append(event)
        self._going -= {event.device.name for event in answers if event.ended}
        return answers

    def events(self, duration_s: float) -> Iterator[Event]:
        """The data of the devices in ``duration_s`` seconds of robot time from now, and a little beyond it.

        Each device has to get there; hardware that is silent then is not waited for.
        """
        until = self.clock.now() + duration_s
        behind = set(self._going)
        for event in self._in_turn() if self._config.is_virtual else self._from_threads(until + GRACE_S):
            if event.ended or event.newest >= until:
                behind.discard(event.device.name)
            yield event
            if not behind:
                return

    def _from_threads(self, until: float) -> Iterator[Event]:
        while self._going and self.clock.now() < until:
            with suppress(Empty):
                yield self._events.get(timeout=WAIT_S)

    def _in_turn(self) -> Iterator[Event]:
        """A virtual robot's devices, always the one that is furthest behind: none gets far ahead of the others."""
        newest = dict.fromkeys(self._going, -math.inf)
        while newest:
            name = min(newest, key=newest.__getitem__)
            event = next(self._streams[name], None)
            if event is None:
                del newest[name]
            else:
                newest[name] = max(newest[name], event.newest)
                yield event

    def _buses(self) -> Iterator[Device]:
        for joints in self._config.buses():
            names = tuple(joint.name for joint in joints)
            yield Device(f"servos {', '.join(names)}", names, self._config.make_bus(joints, self.clock))

    def _accelerometers(self) -> Iterator[Device]:
        for options in self._config.accelerometers:
            sensor = self._config.make_accelerometer(options, self.clock)
            yield Device(f"accelerometer {options.name}", (options.name,), sensor)

    def _stream(self, device: Device) -> Iterator[Event]:
        """All events of a device."""
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
        for event in self._streams[device.name]:
            while not self._stop.is_set():
                with suppress(Full):
                    self._events.put(event, timeout=WAIT_S)
                    break
            if isinstance(event.data, AccelBlock):
                self._stop.wait(GATHER_S)
