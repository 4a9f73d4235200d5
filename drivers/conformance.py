"""The requirements of the service on a driver, as checks that other packages can run in their tests.

    from lostmotion.drivers.conformance import CHECKS, Subject

    subject = Subject("my_driver", accelerometer={"port": "5006", "rate_hz": 1000, "oscillator": {"f_res_hz": 58}})

    @pytest.mark.parametrize("check", CHECKS)
    def test_conformance(check):
        check(subject)

Each check takes the driver by its name, as the service does, and needs the device to be there.  What fails raises
ConformanceError.  No test framework is imported.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import msgspec
import numpy as np

from lostmotion.drivers.base import AccelBlock, Accelerometer, ServoBus, ServoReading
from lostmotion.drivers.clock import SystemClock
from lostmotion.drivers.registry import get_driver

__all__ = ["CHECKS", "ConformanceError", "Subject", "collect"]

LEAST = 5
"""readings that are looked at, at least"""
SAMPLES = 20
"""of each joint or sensor whose times are looked at, at least"""
MOST_S = 20.0
"""in which so many must have come"""
FASTEST_RAD_S, HOTTEST_C, VOLTS = 20.0, 90.0, (3.0, 60.0)
FARTHEST_RAD = 0.2
"""of the position from the command"""
Reading = ServoReading | AccelBlock


class ConformanceError(AssertionError):
    """A driver violates what the service expects; the message has the violation."""


@dataclass(frozen=True)
class Subject:
    """One driver in one role.

    driver: its name in the registry; joints, or else accelerometer: the keys of its tables beside name and driver;
    robot: those of its own table.
    """

    driver: str
    joints: Sequence[Mapping[str, Any]] = ()
    accelerometer: Mapping[str, Any] = field(default_factory=dict)
    robot: Mapping[str, Any] = field(default_factory=dict)

    @property
    def names(self) -> tuple[str, ...]:
        """What the joints, or the accelerometer, are called in the checks."""
        return tuple(f"joint{i}" for i in range(len(self.joints))) or ("tip",)

    @property
    def tables(self) -> list[dict[str, Any]]:
        """The tables as in a configuration."""
        rows = [{"accelerometer": "tip", **joint} for joint in self.joints] or [dict(self.accelerometer)]
        return [{"name": name, "driver": self.driver, **row} for name, row in zip(self.names, rows, strict=True)]

    def make(self) -> ServoBus | Accelerometer:
        """The driver, through the registry and the strict decoder as the service makes it; not open."""
        row = get_driver(self.driver)
        robot = msgspec.convert(dict(self.robot), row.robot_options)
        clock = row.clock(robot) if row.clock else SystemClock()
        if self.joints:
            _expect(row.servo is not None, f"{self.driver} has no servo")
            assert row.servo is not None
            return row.servo([msgspec.convert(table, row.joint_options) for table in self.tables], robot, clock)
        _expect(row.accelerometer is not None, f"{self.driver} has no accelerometer")
        assert row.accelerometer is not None
        return row.accelerometer(msgspec.convert(self.tables[0], row.accelerometer_options), robot, clock)


def check_identity(subject: Subject) -> None:
    """identify names every joint or sensor once, reports what was found and expected, and accepts it."""
    with _opened(subject) as driver:
        identities = driver.identify()
    found = tuple(identity.name for identity in identities)
    _expect(found == subject.names, f"identify names {found}, expected {subject.names}")
    for identity in identities:
        _expect(identity.ok, f"{identity.name}: found {identity.found}, expected {identity.expected}")
        _expect(bool(identity.found and identity.expected), f"{identity.name}: found or expected is empty")


def check_times(subject: Subject) -> None:
    """Over all readings the times of each joint and sensor ascend strictly; those in a reading are in order."""
    times: dict[str, list[float]] = {name: [] for name in subject.names}
    with _opened(subject) as driver:
        start = time.monotonic()
        while min(map(len, times.values())) < SAMPLES and time.monotonic() - start < MOST_S:
            for reading in collect(driver):
                _note(reading, times)
    for name, stamps in times.items():
        _expect(len(stamps) >= SAMPLES, f"{name}: {len(stamps)} samples in {MOST_S:g} s, expected {SAMPLES} and more")
        _expect(bool(np.diff(stamps).min() > 0), f"{name}: a time is not later than the one before it")


def _note(reading: Reading, times: dict[str, list[float]]) -> None:
    """Adds the times in a reading to those of its joints or its sensor."""
    if isinstance(reading, AccelBlock):
        times[next(iter(times))] += reading.time.tolist()
        return
    within = [sample.time for sample in reading.samples]
    _expect(within == sorted(within), "the samples of a reading are not in the order of their times")
    for sample in reading.samples:
        times[sample.joint].append(sample.time)


def check_values(subject: Subject) -> None:
    """Angles, speeds, volts and °C of a working servo; a tip within the sensor's range that is not dead."""
    with _opened(subject) as driver:
        readings = collect(driver, 1.0)
        blocks = [reading for reading in readings if isinstance(reading, AccelBlock)]
        limit = min(getattr(driver, "range_ms2", math.inf), 2000.0)
    for sample in (s for reading in readings if isinstance(reading, ServoReading) for s in reading.samples):
        _within(sample.joint, "command [rad]", sample.command, -math.tau, math.tau, may_lack=False)
        _within(sample.joint, "position - command [rad]", sample.position - sample.command, -FARTHEST_RAD, FARTHEST_RAD)
        _within(sample.joint, "velocity [rad/s]", sample.velocity, -FASTEST_RAD_S, FASTEST_RAD_S)
        _within(sample.joint, "voltage [V]", sample.voltage, *VOLTS)
        _within(sample.joint, "temperature [°C]", sample.temperature, 0, HOTTEST_C)
    if blocks:
        _expect(all(block.time.shape == block.accel.shape for block in blocks), "as many times as accelerations")
        largest = float(np.nanmax(np.abs(np.concatenate([block.accel for block in blocks]))))
        _within(subject.names[0], "largest acceleration [m/s²]", largest, 0.01, limit, may_lack=False)


def check_resolution(subject: Subject) -> None:
    """A bus has the step of its command, on which commands lie (0: continuous, NaN: unknown); a sensor its range."""
    with _opened(subject) as driver:
        if not subject.joints:
            _expect(getattr(driver, "range_ms2", math.nan) > 0, "range_ms2 is missing or not above 0")
            return
        readings = collect(driver)
        step = float(getattr(driver, "resolution_rad", -1))
    commands = np.array([s.command for r in readings if isinstance(r, ServoReading) for s in r.samples])
    _expect(math.isnan(step) or step >= 0, "resolution_rad is missing or negative")
    if step > 0:
        off = float(np.abs(commands / step - np.rint(commands / step)).max())
        _expect(off < 1e-6, f"commands are {off:.2g} steps off the grid of {step:g} rad")


def check_reopening(subject: Subject) -> None:
    """close may be called before opening and twice; afterwards open and read work again."""
    driver = subject.make()
    driver.close()
    driver.open()
    driver.read()
    driver.close()
    driver.close()
    with _opened(subject, driver):
        collect(driver, 0.1)


def check_unknown_keys(subject: Subject) -> None:
    """A misspelt key in a table is an error, not ignored."""
    row = get_driver(subject.driver)
    kind = row.joint_options if subject.joints else row.accelerometer_options
    msgspec.convert(subject.tables[0], kind)
    try:
        msgspec.convert({**subject.tables[0], "bodrate": 1}, kind)
    except msgspec.ValidationError as error:
        _expect("bodrate" in str(error), f"a misspelt key is not named: {error}")
        return
    raise ConformanceError("a misspelt key is taken; expected forbid_unknown_fields=True")


CHECKS: tuple[Callable[[Subject], None], ...] = (
    check_identity,
    check_times,
    check_values,
    check_resolution,
    check_reopening,
    check_unknown_keys,
)


def collect(driver: ServoBus | Accelerometer, seconds: float = 0.6) -> list[Reading]:
    """All readings of some seconds, at least five.  Raises ConformanceError when these take too long."""
    start, found = time.monotonic(), list[Reading]()
    while (spent := time.monotonic() - start) < seconds or len(found) < LEAST:
        _expect(spent < MOST_S, f"{len(found)} readings in {MOST_S:g} s: read is to return within 0.3 s")
        found.append(driver.read())
    return found


@contextmanager
def _opened(subject: Subject, made: ServoBus | Accelerometer | None = None) -> Iterator[ServoBus | Accelerometer]:
    driver = made or subject.make()
    driver.open()
    try:
        yield driver
    finally:
        driver.close()


def _within(name: str, what: str, value: float, low: float, high: float, may_lack: bool = True) -> None:
    if not (may_lack and math.isnan(value)):
        _expect(low <= value <= high, f"{name}: {what} is {value:.4g}, expected {low:.4g} to {high:.4g}")


def _expect(condition: bool, words: str) -> None:
    if not condition:
        raise ConformanceError(words)
