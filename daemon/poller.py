"""One thread for each servo bus and accelerometer: open, identify, read, and again when the port went away.

A poller computes no windows and no scores.  It passes on what was read and keeps the public status of its device: its
state, why, and how many samples came, were lost, late or broken.
"""

from __future__ import annotations

import logging
import math
import threading
import time
from collections import Counter, deque
from dataclasses import dataclass, field
from enum import Enum

import numpy as np

from lostmotion.daemon.repeats import Condition
from lostmotion.daemon.ring import Ring
from lostmotion.daemon.waker import Waker
from lostmotion.drivers.base import Accelerometer, Identity, ServoBus, ServoSample
from lostmotion.drivers.clock import CYCLE_S, next_cycle
from lostmotion.drivers.errors import DriverError, EndOfData, IdentityError, PortError

__all__ = ["INBOX_READINGS", "AccelPoller", "BusPoller", "DeviceState", "DeviceStatus", "Inbox", "Poller"]

log = logging.getLogger(__name__)

FIRST_RETRY_S = 0.5
LAST_RETRY_S = 10.0
WRONG_RETRY_S = 30.0
"""how often a device that was not the expected one is asked again, at last [s]: sooner at first, since a line that was
bad for a moment looks like another device"""
GATHER_SAMPLES = 150
"""so many samples of an accelerometer are read together at most: they fit into the 4096 bytes of a tty"""
INBOX_READINGS = 4
"""a virtual bus waits while more readings than this are unread: all are scored in one step, which nothing ends early.
With 1000 a step was up to minutes of motion and ten seconds long, with 4 it is 0.1 s, at the same processor time"""


class DeviceState(Enum):
    """The state of a poller."""

    OPENING = "opening"
    READING = "reading"
    RETRYING = "retrying"  # the port is missing, busy or went away
    WRONG = "wrong device"  # something else answers
    ENDED = "ended"  # a replay has come to its end


@dataclass(slots=True)
class DeviceStatus:
    """The state of one device; written by its poller, read by anyone.

    faults: by joint or accelerometer, why it is not what was expected; last_seen: by the same names, host time [s]
    (monotonic) of the last data; asked and usable: by the same names, how many samples were asked for and how many
    came whole.
    """

    state: DeviceState = DeviceState.OPENING
    reason: str = ""
    samples: int = 0
    lost: int = 0
    late: int = 0
    broken: int = 0
    silent: int = 0
    faults: dict[str, str] = field(default_factory=dict)
    last_seen: dict[str, float] = field(default_factory=dict)
    asked: Counter[str] = field(default_factory=Counter)
    usable: Counter[str] = field(default_factory=Counter)


@dataclass(slots=True)
class Inbox:
    """Servo samples on their way to the pipeline, with the resolution of their command [rad]; and what wakes
    the main thread."""

    waker: Waker = field(default_factory=Waker)
    servo: deque[tuple[float, tuple[ServoSample, ...]]] = field(default_factory=deque)


class Poller:
    """Keeps one device running until ``stop`` is set.

    members: the joints, or the accelerometer, behind it; pulse: host time (monotonic) [s] of the last sign of life of
    its thread; while that rests, of the end of the rest; inf when it has nothing more to do.
    """

    def __init__(
        self, name: str, members: tuple[str, ...], device: ServoBus | Accelerometer, stop: threading.Event
    ) -> None:
        self.name = name
        self.members = members
        self.status = DeviceStatus()
        self.pulse = time.monotonic()
        self._device = device
        self._stop = stop
        self._check_again = math.inf
        self._condition = Condition()

    def run(self) -> None:
        """Runs the device until ``stop`` or the end of a replay."""
        pause = FIRST_RETRY_S
        while not self._stop.is_set():
            longest = LAST_RETRY_S
            try:
                self.pulse = time.monotonic()
                self._start()
                pause = FIRST_RETRY_S
                self._read_on()
            except EndOfData:
                self._now(DeviceState.ENDED, "")
            except PortError as error:
                self._now(DeviceState.RETRYING, str(error))
            except DriverError as error:
                self._now(DeviceState.WRONG, str(error))
                longest = WRONG_RETRY_S
                pause = min(pause, longest) if isinstance(error, IdentityError) else longest
            finally:
                self._device.close()
            if self.status.state is DeviceState.ENDED:
                break
            self.rest(pause)
            pause = min(2 * pause, longest)
        self.pulse = math.inf
        self._end()

    def fail(self, reason: str) -> None:
        """Notes that the poller itself broke down."""
        self._now(DeviceState.WRONG, reason)

    def supply(self, member: str, now: float) -> tuple[float, float]:
        """How many samples of a member should have come by host time ``now`` [s], and how many did, since any start."""
        return self.status.asked[member], self.status.usable[member]

    def named(self, reason: str) -> str:
        """A reason with the device's name before it."""
        return reason if reason.startswith(f"{self.name}: ") else f"{self.name}: {reason}"

    def rest(self, seconds: float) -> None:
        """Waits so long, or until it is to stop."""
        self.pulse = time.monotonic() + seconds
        self._stop.wait(seconds)

    def _start(self) -> None:
        """Opens the port and asks who is there; one wrong servo of several does not stop the others."""
        self._device.open()
        self._note(self._device.identify())
        if len(self.status.faults) == len(self.members):
            raise IdentityError("; ".join(self.status.faults.values()))
        self._now(DeviceState.READING, "")

    def _note(self, identities: tuple[Identity, ...]) -> None:
        before = self.status.faults
        wrong = [who for who in identities if not who.ok]
        self.status.faults = {
            who.name: f"{who.name}: found {who.gist or who.found}, expected {who.expected}" for who in wrong
        }
        for who in wrong:
            if before.get(who.name) != self.status.faults[who.name]:
                log.error("%s", self.named(f"{who.name}: found {who.found}, expected {who.expected}"))
        self._check_again = time.monotonic() + WRONG_RETRY_S if self.status.faults else math.inf

    def _read_on(self) -> None:
        while not self._stop.is_set():
            self._read()
            self.pulse = time.monotonic()
            if self.pulse > self._check_again:
                self._note(self._device.identify())

    def _read(self) -> None:
        raise NotImplementedError

    def _end(self) -> None:
        """Called once, when nothing more will come."""

    def _now(self, state: DeviceState, reason: str) -> None:
        self.status.state, self.status.reason = state, reason
        bad = state in (DeviceState.RETRYING, DeviceState.WRONG)
        text = f"{self.name}: {state.value}" + (f": {reason.removeprefix(f'{self.name}: ')}" if bad else "")
        if not self._condition.is_news(text if bad else "", time.monotonic()) and state is not DeviceState.ENDED:
            return
        fields = {"kind": "device", "device": self.name, "state": state.value, "reason": reason}
        log.log(logging.WARNING if bad else logging.INFO, "%s", text, extra={"fields": fields})


class BusPoller(Poller):
    """Puts the samples of all good joints of one bus into the inbox.  ``waits``: its data can wait for the reader."""

    def __init__(
        self, name: str, members: tuple[str, ...], bus: ServoBus, stop: threading.Event, inbox: Inbox, waits: bool
    ) -> None:
        super().__init__(name, members, bus, stop)
        self._bus = bus
        self._inbox = inbox
        self._waits = waits

    @property
    def resolution_rad(self) -> float:
        """The step of its commands [rad]."""
        return self._bus.resolution_rad

    def _read(self) -> None:
        reading = self._bus.read()
        status, now = self.status, time.monotonic()
        status.lost += reading.lost
        status.broken += reading.broken
        status.silent += len(reading.silent)
        status.asked.update(reading.silent)
        samples = reading.samples
        if status.faults:
            samples = tuple(sample for sample in samples if sample.joint not in status.faults)
        if not samples:
            return
        status.samples += len(samples)
        names = [sample.joint for sample in samples]
        status.last_seen.update(dict.fromkeys(names, now))
        status.asked.update(names)
        status.usable.update(names)
        self._inbox.servo.append((self._bus.resolution_rad, samples))
        if self._waits:
            self._inbox.waker.wake()
        while self._waits and len(self._inbox.servo) > INBOX_READINGS and not self._stop.is_set():
            self._stop.wait(0.002)

    def _end(self) -> None:
        self._inbox.waker.wake()


class AccelPoller(Poller):
    """Puts the samples of one accelerometer into its ring.

    period: of its samples [s]; waits: its data can wait for room in the ring; cycle: in which it is read [s].
    """

    def __init__(
        self,
        name: str,
        device: Accelerometer,
        stop: threading.Event,
        ring: Ring,
        period: float,
        waits: bool,
        cycle: float = CYCLE_S,
    ) -> None:
        super().__init__(name, (name,), device, stop)
        self._sensor = device
        self._ring = ring
        self._period = period
        self._pause = cycle / math.ceil(cycle / (GATHER_SAMPLES * period))
        self._wait = stop if waits else None
        self._is_behind = False

    def _read(self) -> None:
        if self._wait is None and not self._is_behind:
            self._gather()
        block = self._sensor.read()
        # A driver may hand on one message at a time: those that wait are read at once.
        self._is_behind = bool(len(block.time)) and float(block.time[-1]) < time.monotonic() - self._pause
        status = self.status
        status.lost += block.lost
        status.late += block.late
        status.broken += block.broken
        if len(block.time):
            status.samples += len(block.time)
            status.last_seen[self.name] = time.monotonic()
            status.usable[self.name] += int(np.count_nonzero(np.isfinite(block.accel)))
            self._ring.range_ms2 = self._sensor.range_ms2
            self._ring.push(block, self._wait)

    def supply(self, member: str, now: float) -> tuple[float, float]:
        return now / self._period, self.status.usable[member]

    def _gather(self) -> None:
        """Leaves hardware alone for a cycle, or for as long a part of it as its samples may gather."""
        now = time.monotonic()
        time.sleep(next_cycle(now, self._pause) - now)

    def _end(self) -> None:
        self._ring.end()
