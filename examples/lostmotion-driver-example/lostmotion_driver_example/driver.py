"""The driver: joints and a sensor that arrive as datagrams of text.  Nothing is ever sent.

Joints: a line ``number,command,position`` [rad] each; the sensor: a line ``seconds,m/s²`` a sample, on its own clock.
A port is a UDP port number; joints and the sensor have one each.
"""

from __future__ import annotations

import math
import socket
from collections.abc import Sequence

import numpy as np

from lostmotion.drivers.base import (
    AccelBlock,
    AccelerometerOptions,
    Driver,
    Identity,
    JointOptions,
    RobotOptions,
    ServoReading,
    ServoSample,
)
from lostmotion.drivers.clock import Clock
from lostmotion.drivers.errors import PortError
from lostmotion.drivers.timeline import Timeline

__all__ = ["DRIVER"]

WAIT_S = 0.25
"""read is to return within about 0.3 s"""
LOOK_S = 1.0
"""how long identify listens"""
SILENT_S = 0.5
"""a joint without data for this time is silent"""
NOTHING = np.empty(0)


class GatewayJoint(JointOptions, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """number: of the joint, as the controller counts them."""

    number: int


class GatewaySensor(AccelerometerOptions, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """No keys of its own."""


class Datagrams:
    """A UDP port that is listened to."""

    def __init__(self, port: str) -> None:
        self._port = port
        self._socket: socket.socket | None = None

    def open(self) -> None:
        """Takes the port.  Raises PortError."""
        self.close()
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.settimeout(WAIT_S)
        try:
            self._socket.bind(("127.0.0.1", int(self._port)))
        except (OSError, ValueError, OverflowError) as error:
            self.close()
            raise PortError(f"UDP port {self._port} cannot be opened: {error}; expected a free one") from error

    def receive(self) -> list[list[float]]:
        """The numbers of the next datagram, a list a line; an empty list for a broken line, none after 0.25 s."""
        if self._socket is None:
            raise PortError(f"UDP port {self._port} is not open")
        try:
            data = self._socket.recv(65536)
        except TimeoutError:
            return []
        except OSError as error:
            raise PortError(f"UDP port {self._port} went away: {error}") from error
        return [_numbers(line) for line in data.splitlines()]

    def close(self) -> None:
        """Gives the port back."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None


def _numbers(line: bytes) -> list[float]:
    try:
        return [float(cell) for cell in line.split(b",")]
    except ValueError:
        return []


class GatewayBus:
    """All joints that arrive on one port."""

    resolution_rad = 0.0  # the controller's commands are not rounded

    def __init__(self, joints: Sequence[GatewayJoint], robot: RobotOptions, clock: Clock) -> None:
        self._names = {joint.number: joint.name for joint in joints}
        self._datagrams = Datagrams(joints[0].port)
        self._clock = clock
        self._heard: dict[str, float] = {}

    def open(self) -> None:
        self._datagrams.open()
        self._heard = dict.fromkeys(self._names.values(), self._clock.now())

    def identify(self) -> tuple[Identity, ...]:
        found, end = set[int](), self._clock.now() + LOOK_S
        while self._clock.now() < end and not found >= set(self._names):
            found |= {int(line[0]) for line in self._datagrams.receive() if len(line) == 3}
        cause = "likely cause: another number, or the controller sends to another port"
        return tuple(
            Identity(name, "angles" if number in found else f"nothing; {cause}", "angles", number in found)
            for number, name in self._names.items()
        )

    def read(self) -> ServoReading:
        lines = self._datagrams.receive()
        now = self._clock.now()
        good = [line for line in lines if len(line) == 3 and all(map(math.isfinite, line))]
        samples = tuple(
            ServoSample(self._names[int(number)], now, command, position)
            for number, command, position in good
            if number in self._names
        )
        self._heard |= {sample.joint: now for sample in samples}
        silent = tuple(name for name, last in self._heard.items() if last < now - SILENT_S)
        return ServoReading(samples, silent, broken=len(lines) - len(good))

    def close(self) -> None:
        self._datagrams.close()


class GatewayAccelerometer:
    """The sensor, which has a clock of its own."""

    range_ms2 = math.inf

    def __init__(self, options: GatewaySensor, robot: RobotOptions, clock: Clock) -> None:
        self._options, self._clock = options, clock
        self._datagrams = Datagrams(options.port)
        self._timeline = Timeline(1 / options.rate_hz, wraps=math.inf)

    def open(self) -> None:
        self._datagrams.open()
        self._timeline = Timeline(1 / self._options.rate_hz, wraps=math.inf)

    def identify(self) -> tuple[Identity, ...]:
        end, stamps = self._clock.now() + LOOK_S, list[float]()
        while self._clock.now() < end and len(stamps) < 100:
            stamps += [line[0] for line in self._datagrams.receive() if len(line) == 2]
        expected = f"samples at {self._options.rate_hz:g} Hz"
        if len(stamps) < 2 or stamps[-1] <= stamps[0]:
            found = "nothing; likely cause: the controller sends to another port"
            return (Identity(self._options.name, found, expected, False),)
        rate = (len(stamps) - 1) / (stamps[-1] - stamps[0])
        ok = abs(rate / self._options.rate_hz - 1) < 0.1
        return (Identity(self._options.name, f"samples at {rate:.0f} Hz", expected, ok),)

    def read(self) -> AccelBlock:
        lines = self._datagrams.receive()
        good = [line for line in lines if len(line) == 2 and all(map(math.isfinite, line))]
        broken = len(lines) - len(good)
        if not good:
            return AccelBlock(NOTHING, NOTHING, broken=broken)
        seconds, accel = np.array(good).T
        return self._timeline.stamped(seconds, accel, self._clock.now(), broken)

    def close(self) -> None:
        self._datagrams.close()


def _bus(joints: Sequence[JointOptions], robot: RobotOptions, clock: Clock) -> GatewayBus:
    return GatewayBus([joint for joint in joints if isinstance(joint, GatewayJoint)], robot, clock)


def _accelerometer(options: AccelerometerOptions, robot: RobotOptions, clock: Clock) -> GatewayAccelerometer:
    assert isinstance(options, GatewaySensor)
    return GatewayAccelerometer(options, robot, clock)


DRIVER = Driver(
    name="example_gateway",
    summary="a controller that sends joints and acceleration as UDP datagrams",
    servo=_bus,
    accelerometer=_accelerometer,
    joint_options=GatewayJoint,
    accelerometer_options=GatewaySensor,
)
