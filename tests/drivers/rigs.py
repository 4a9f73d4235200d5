"""Emulated hardware and the drivers that belong to it, for all tests of drivers."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Any

import msgspec
import numpy as np

from lostmotion.drivers.base import AccelBlock, Accelerometer, OscillatorOptions, ServoBus, ServoReading
from lostmotion.drivers.clock import SystemClock
from lostmotion.drivers.codec import feetech
from lostmotion.drivers.emulator import FeetechLine, Motion, ServoLine
from lostmotion.drivers.registry import get_driver

MOTION = Motion(play=1.0)
OSCILLATOR = OscillatorOptions(f_res_hz=58.0)


def servo_line(model: str, ids: Sequence[int]) -> ServoLine:
    """Emulated servos, Feetech's or Dynamixel's by their model."""
    return (FeetechLine if model in feetech.MODELS else ServoLine).of(model, ids, MOTION)


def servo_bus(
    port: str, ids: Sequence[int], models: Sequence[str] | str = "AX-12A", poll_hz: float = 100.0
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
    return driver.servo(joints, driver.robot_options(), SystemClock())


def accelerometer(name: str, port: str, rate_hz: float, **options: Any) -> Accelerometer:
    """The driver of an accelerometer on a port."""
    driver = get_driver(name)
    row = driver.accelerometer_options(
        name="tip", driver=name, port=port, rate_hz=rate_hz, **{"oscillator": OSCILLATOR, **options}
    )
    assert driver.accelerometer is not None
    return driver.accelerometer(row, driver.robot_options(), SystemClock())


def readings(bus: ServoBus, seconds: float) -> list[ServoReading]:
    """All readings of some seconds."""
    end, found = time.monotonic() + seconds, []
    while time.monotonic() < end:
        found.append(bus.read())
    return found


def block(sensor: Accelerometer, seconds: float) -> AccelBlock:
    """The blocks of some seconds as one."""
    end, blocks = time.monotonic() + seconds, []
    while time.monotonic() < end:
        blocks.append(sensor.read())
    return AccelBlock(
        np.concatenate([b.time for b in blocks]),
        np.concatenate([b.accel for b in blocks]),
        sum(b.lost for b in blocks),
        sum(b.late for b in blocks),
        sum(b.broken for b in blocks),
    )


def until(condition: Callable[[], object], seconds: float = 20.0) -> None:
    """Tries again until something is so; fails when it takes too long."""
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "waited in vain"
