"""Emulated hardware and the drivers that belong to it, for all tests of drivers."""

from __future__ import annotations

import time
from bisect import bisect_left
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import msgspec
import numpy as np
import pytest

from lostmotion.drivers.base import AccelBlock, Accelerometer, OscillatorOptions, ServoBus, ServoReading, ServoSample
from lostmotion.drivers.clock import CYCLE_S, SystemClock
from lostmotion.drivers.codec import feetech
from lostmotion.drivers.emulator import FeetechLine, Motion, ServoLine, VirtualServo
from lostmotion.drivers.emulator.motion import PERIOD_S
from lostmotion.drivers.registry import get_driver

MOTION = Motion(play=1.0)
OSCILLATOR = OscillatorOptions(f_res_hz=58.0)
PATIENCE_S = 0.5


def wait_long(monkeypatch: pytest.MonkeyPatch) -> None:
    """An emulated servo answers when the machine lets its thread run: the drivers in this process wait 15 times as long
    for it as for a real one."""
    monkeypatch.setattr("lostmotion.drivers.servo_port.LATENCY_S", PATIENCE_S)


def servo_line(model: str, ids: Sequence[int]) -> ServoLine:
    """Emulated servos, Feetech's or Dynamixel's by their model."""
    return (FeetechLine if model in feetech.MODELS else ServoLine).of(model, ids, MOTION)


def servo_bus(
    port: str,
    ids: Sequence[int],
    models: Sequence[str] | str = "AX-12A",
    poll_hz: float = 100.0,
    cycle_s: float = CYCLE_S,
) -> ServoBus:
    """The driver of servos on a port, Feetech's or Dynamixel's by their model; their joints are called by their ids."""
    names = [models] * len(ids) if isinstance(models, str) else models
    driver = get_driver("feetech" if names[0] in feetech.MODELS else "dynamixel")
    common = {"driver": driver.name, "port": port, "accelerometer": "tip", "poll_hz": poll_hz}
    joints = [
        msgspec.convert({"name": str(id), "id": id, "model": model, **common}, driver.joint_options)
        for id, model in zip(ids, names, strict=True)
    ]
    assert driver.servo is not None
    return driver.servo(joints, driver.robot_options(), SystemClock(cycle_s))


def accelerometer(name: str, port: str, rate_hz: float, **options: Any) -> Accelerometer:
    """The driver of an accelerometer on a port."""
    driver = get_driver(name)
    row = driver.accelerometer_options(
        name="tip", driver=name, port=port, rate_hz=rate_hz, **{"oscillator": OSCILLATOR, **options}
    )
    assert driver.accelerometer is not None
    return driver.accelerometer(row, driver.robot_options(), SystemClock())


def readings(bus: ServoBus, enough: Callable[[list[ServoReading]], object]) -> list[ServoReading]:
    """All readings until they are enough, however long a busy machine takes for them."""
    found: list[ServoReading] = []

    def are_enough() -> bool:
        found.append(bus.read())
        return bool(enough(found))

    until(are_enough)
    return found


def samples(found: Iterable[ServoReading], joint: str = "") -> list[ServoSample]:
    """The samples in readings, of all joints or of one."""
    return [sample for reading in found for sample in reading.samples if joint in ("", sample.joint)]


class Witness:
    """Notes when an emulated servo tells its state, from now on."""

    def __init__(self, servo: VirtualServo) -> None:
        self.times: list[float] = []
        self._servo = servo
        self._read = servo.read
        servo.read = self._noted  # type: ignore[method-assign]

    def commands(self) -> list[float]:
        """All goals told [rad]."""
        return [self._servo.state(time).command for time in self.times]

    def confirms(self, sample: ServoSample, older: int = 0) -> bool:
        """Whether the first state told after a sample's time is the sample's, or one of some told before, to half a
        count."""
        at = bisect_left(self.times, sample.time)
        goals = [self._servo.state(time).command for time in self.times[max(at - older, 0) : at + 1]]
        return any(abs(goal - sample.command) < 0.501 * self._servo.model.step for goal in goals)

    def _noted(self, parameters: bytes, now: float) -> bytes:
        self.times.append(now)
        return self._read(parameters, now)


class Polls:
    """The polls of a bus, from when it is opened until it is asked for them."""

    def __init__(self, bus: ServoBus, rate_hz: float = 100.0) -> None:
        self._period = 1 / rate_hz
        self._before = time.monotonic()
        bus.open()
        self._after = time.monotonic()

    def are_counted(self, found: Sequence[ServoReading], servos: int) -> bool:
        """Whether samples and lost polls are the turns of so many servos, and no servo was asked before its turn.

        The first turn is when the bus is opened, the next one to come lies within a period from now.
        """
        turns = sum(len(reading.samples) + reading.lost for reading in found) / servos
        times = [sample.time for sample in samples(found, found[0].samples[0].joint)]
        too_soon = any(time < self._before + turn * self._period for turn, time in enumerate(times))
        end = time.monotonic() - self._before + self._period
        return not too_soon and times[-1] - self._after <= turns * self._period <= end


def some(count: int, *joints: str) -> Callable[[list[ServoReading]], bool]:
    """Whether there are so many samples of each joint."""
    return lambda found: all(len(samples(found, joint)) >= count for joint in joints)


def block(sensor: Accelerometer, count: int) -> AccelBlock:
    """Blocks with so many samples as one, however long a busy machine takes for them."""
    return timed_block(sensor, count)[0]


Late = Callable[[int], float]


def timed_block(sensor: Accelerometer, count: int, rate_hz: float = 1000.0) -> tuple[AccelBlock, Late]:
    """The same, and how old a sample was at most when it was read [s], by the number of the first sample on the
    emulator's motion."""
    blocks: list[AccelBlock] = []
    read: list[float] = []

    def are_enough() -> bool:
        blocks.append(sensor.read())
        read.append(time.monotonic())
        return sum(len(one.time) for one in blocks) >= count

    def late(first: int) -> float:
        newest = (first - 1 + np.cumsum([len(one.time) for one in blocks])) / rate_hz
        return float(((read - newest) % PERIOD_S).max())

    until(are_enough)
    whole = AccelBlock(
        np.concatenate([b.time for b in blocks]),
        np.concatenate([b.accel for b in blocks]),
        sum(b.lost for b in blocks),
        sum(b.late for b in blocks),
        sum(b.broken for b in blocks),
    )
    return whole, late


def until(condition: Callable[[], object], seconds: float = 60.0) -> None:
    """Tries again until something is so; fails when it takes too long."""
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "waited in vain"
