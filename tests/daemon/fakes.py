"""A driver made of real threads' sleeps and a sine: hardware as the service sees it, quick to start.

``python -m tests.daemon.fakes CONFIG`` runs the service with it, as ``lostmotion run`` would.
"""

from __future__ import annotations

import math
import os
import resource
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from lostmotion.daemon import config, service
from lostmotion.drivers import clock, registry
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

WAVE_HZ = 2.0
"""the command's frequency: it reverses its acceleration four times a second"""


class FakeOptions(RobotOptions, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Files: the existence of ``missing`` makes the ports go away, that of ``hanging`` reading from them never end."""

    missing: str = ""
    hanging: str = ""


class Periodic:
    """Robot times of samples since the last call, at a fixed rate."""

    def __init__(self, rate_hz: float, clock: Clock, robot: RobotOptions) -> None:
        assert isinstance(robot, FakeOptions)
        self._rate = rate_hz
        self._clock = clock
        self._missing = robot.missing
        self._hanging = robot.hanging
        self._next = 0

    def open(self) -> None:
        if self._missing and Path(self._missing).exists():
            raise PortError("fake: the port is missing")
        self._next = math.ceil(self._clock.now() * self._rate)

    def times(self) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
        time.sleep(0.005)
        while self._hanging and Path(self._hanging).exists():
            time.sleep(0.01)
        if self._missing and Path(self._missing).exists():
            raise PortError("fake: the port went away")
        first, self._next = self._next, math.floor(self._clock.now() * self._rate) + 1
        return np.arange(first, self._next) / self._rate

    def close(self) -> None:
        """Nothing is held open."""


class FakeBus(Periodic):
    """Every joint swings at WAVE_HZ, and reports no angle with which the sensor could be compared."""

    resolution_rad = 0.0

    def __init__(self, joints: Sequence[JointOptions], robot: RobotOptions, clock: Clock) -> None:
        super().__init__(joints[0].poll_hz, clock, robot)
        self._names = [joint.name for joint in joints]

    def identify(self) -> tuple[Identity, ...]:
        return tuple(Identity(name, "fake", "fake", ok=name != "impostor") for name in self._names)

    def read(self) -> ServoReading:
        return ServoReading(
            tuple(
                ServoSample(name, float(t), 0.5 * math.sin(2 * math.pi * WAVE_HZ * t), math.nan, temperature=40.0)
                for t in self.times()
                for name in self._names
            )
        )


class FakeSensor(Periodic):
    """Noise of a known seed."""

    range_ms2 = 100.0

    def __init__(self, options: AccelerometerOptions, robot: RobotOptions, clock: Clock) -> None:
        super().__init__(options.rate_hz, clock, robot)
        self._name = options.name
        self._noise = np.random.default_rng(1)

    def identify(self) -> tuple[Identity, ...]:
        return (Identity(self._name, "fake", "fake", ok=True),)

    def read(self) -> AccelBlock:
        times = self.times()
        return AccelBlock(times, self._noise.normal(size=len(times)))


DRIVER = Driver("fake", "a sine and noise", servo=FakeBus, accelerometer=FakeSensor, robot_options=FakeOptions)


def fake_config(folder: Path, extra: str = "", joints: Sequence[str] = ("elbow",)) -> str:
    """A configuration of the fake robot with its database in ``folder``."""
    text = f"""
[robot]
name = "fake"
[store]
path = "{folder / "history.db"}"
[[accelerometer]]
name = "tip"
driver = "fake"
rate_hz = 1000
oscillator = {{ f_res_hz = 58.0 }}
"""
    joint = '[[joint]]\nname = "{}"\ndriver = "fake"\naccelerometer = "tip"\n'
    return text + "".join(joint.format(name) for name in joints) + "\n[detector]\nwindow_s = 0.2\n" + extra


@contextmanager
def files_up_to(size: int) -> Iterator[None]:
    """No file of this process and its children may grow beyond ``size`` bytes: writing fails as on a full disk."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def files_may_grow() -> None:
    """There is room again, before ``files_up_to`` ends."""
    _, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (hard, hard))


def install() -> None:
    """Puts the fake driver into the table."""
    registry.BUILT_IN["fake"] = "tests.daemon.fakes:DRIVER"
    if path := os.environ.get("FAKE_CLOCK"):
        set_clock(Path(path))


def set_clock(ahead: Path) -> None:
    """The system's clock is ahead by the seconds that stand in a file, and no network time has set it."""
    clock.wall = lambda: time.time() + float(ahead.read_text() or 0)
    clock.is_synchronised = lambda: False


if __name__ == "__main__":
    install()
    file = Path(sys.argv[1])
    sys.exit(service.run(config.load(file), reload=lambda: config.load(file)))
