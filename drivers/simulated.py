"""A robot that is the model: joints with play that grows with use, each with a metal bar and an accelerometer.

The robot is the clock: its joints and sensors share one simulation, made step by step as far as the fastest reader has
got.  Where time runs faster than motion is worth computing, it moves in stretches with rest between them, and only the
wear goes on.  The equations are the model's, which is imported when the first device is opened.
"""

from __future__ import annotations

import logging
import math
import threading
import time
from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from datetime import UTC, datetime, timedelta
from operator import attrgetter
from typing import TypeVar

import numpy as np

from lostmotion.drivers.base import (
    AccelBlock,
    AccelerometerOptions,
    Driver,
    Identity,
    JointOptions,
    RobotOptions,
    ServoReading,
)
from lostmotion.drivers.clock import Clock, VirtualClock
from lostmotion.drivers.errors import DriverError
from lostmotion.drivers.pacing import Pace, as_utc
from lostmotion.drivers.packages import is_there, missing
from lostmotion.drivers.schedule import YEAR_S, schedule_step, skips
from lostmotion.drivers.simulated_options import (
    SimulatedAccelerometerOptions,
    SimulatedJointOptions,
    SimulatedOptions,
)
from lostmotion.drivers.simulated_parts import Bar, Gear

__all__ = ["DRIVER", "SimulatedAccelerometer", "SimulatedJoints", "SimulatedRobot"]

log = logging.getLogger(__name__)

T = TypeVar("T")

STEP_S = 0.5
"""A step where time is skipped [s]."""
MOST_RATE = 1e4
"""Velocity [rad/s] and acceleration [rad/s²] of a motion: thousands are a servo's best, and from 5e4 on teeth that meet
would take steps without number."""


class SimulatedRobot(VirtualClock):
    """The time of the robot, and everything that moves in it.

    Joints and sensors join it as they are made and take what it makes for them; the same seed gives the same samples,
    whoever reads first.  ``pace`` replaces the host's clock.
    """

    def __init__(self, robot: RobotOptions, pace: Pace | None = None) -> None:
        assert isinstance(robot, SimulatedOptions)
        speed = math.inf if robot.speed == "max" else robot.speed
        # Time that runs fast would soon be ahead of the calendar, were it to start today.
        self._before = timedelta(seconds=YEAR_S if speed > 1 else 0)
        super().__init__(as_utc(robot.start or datetime.now(UTC) - self._before))
        self._options = robot
        self._speed = speed
        self._pace = pace or Pace(speed)
        self._length = STEP_S if skips(speed) else Pace(speed).step
        self._number = 0
        self._begun = False
        self._joints: list[Gear] = []
        self._sensors: dict[str, Bar] = {}
        self._made = threading.RLock()

    def add_joint(self, options: SimulatedJointOptions) -> Gear:
        """A joint that moves with the robot from now on."""
        with self._made:
            self._joints.append(Gear(options, self._options.seed + len(self._joints)))
            return self._joints[-1]

    def add_sensor(self, options: SimulatedAccelerometerOptions) -> Bar:
        """Adds an accelerometer, simulated from now on."""
        with self._made:
            bar = self._sensors[options.name] = Bar(options, [self._options.seed, len(self._sensors)])
            return bar

    def prepare(self) -> None:
        """Loads and compiles the model, so that no reading has to wait for it.  Raises DriverError.

        A sensor that no joint names moves with a joint without play, which is not reported.
        """
        with self._made, _told_when_compiled():
            for name in sorted(self._sensors.keys() - {joint.options.accelerometer for joint in self._joints}):
                rides_on = SimulatedJointOptions(name=name, driver="simulated", accelerometer=name)
                self.add_joint(rides_on).is_read = False
            for joint in self._joints:
                if others := joint.options.levers_m.keys() - {joint.options.accelerometer}:
                    raise DriverError(
                        f"{joint.options.name}: levers_m: found {', '.join(sorted(others))}, expected only "
                        f"{joint.options.accelerometer}: a simulated joint moves no other accelerometer"
                    )
                joint.prepare(self._options.motion, self._sensors.get(joint.options.accelerometer))

    def collect(self, queues: Sequence[deque[T]]) -> list[T]:
        """What the next step brings for each of these queues; nothing when its time has not come within a moment."""
        with self._made:
            if not any(queues):
                self._step()
            return [queue.popleft() for queue in queues if queue]

    def _step(self) -> None:
        """Makes the next step of all joints and sensors, once its time has come."""
        if not self._begun and self._options.start is None:  # the model may have been compiled for half a minute
            self.begin(datetime.now(UTC) - self._before)
        self._begun = True
        step = schedule_step(self._number, self._length, self._speed)
        if not self._pace.wait(step.end):
            return
        self._number += 1
        tips = {name: np.zeros(len(bar.times(step))) for name, bar in self._sensors.items()}
        for joint in self._joints:
            bar = self._sensors.get(joint.options.accelerometer)
            felt = joint.move(step, bar.times(step) if bar else np.empty(0))
            if bar:
                tips[bar.options.name] += joint.lever_ratio(bar) * felt
        for name, bar in self._sensors.items():
            bar.feel(step, tips[name])
        self.advance(step.end)


@contextmanager
def _told_when_compiled() -> Iterator[None]:
    """Lines in the log when Numba begins to compile the model, as it does once on a machine, and when that is done."""
    from numba.core.event import Event, Listener, install_listener

    begin, compiled = time.thread_time(), list[Event]()

    class Told(Listener):
        def on_start(self, event: Event) -> None:
            if not compiled:
                log.info("the model is being compiled, once on this machine; that may take half a minute")
            compiled.append(event)

        def on_end(self, event: Event) -> None:
            """The end of all is told below."""

    with install_listener("numba:compile", Told()):
        yield
    if compiled:
        took = time.thread_time() - begin
        log.info("the model was compiled in %.0f s of processor time; it is kept for the next start", took)


class SimulatedJoints:
    """The servo bus of a simulated robot."""

    def __init__(self, joints: Sequence[JointOptions], robot: RobotOptions, clock: Clock) -> None:
        assert isinstance(clock, SimulatedRobot)
        self._robot = clock
        self._joints = [clock.add_joint(joint) for joint in joints if isinstance(joint, SimulatedJointOptions)]
        self.resolution_rad = max(joint.options.resolution_rad for joint in self._joints)

    def open(self) -> None:
        """Builds the model, which is compiled if it never was on this machine.  Raises DriverError."""
        self._robot.prepare()
        for joint in self._joints:
            joint.is_read = True

    def identify(self) -> tuple[Identity, ...]:
        return tuple(
            Identity(joint.options.name, description, description, ok=True)
            for joint in self._joints
            for description in [f"simulated joint, play {joint.play_m(self._robot.now()) * 1e6:.0f} µm"]
        )

    def read(self) -> ServoReading:
        samples = [
            sample for batch in self._robot.collect([joint.samples for joint in self._joints]) for sample in batch
        ]
        return ServoReading(tuple(sorted(samples, key=attrgetter("time"))))

    def close(self) -> None:
        """What is not read from now on is not kept."""
        for joint in self._joints:
            joint.is_read = False
            joint.samples.clear()


class SimulatedAccelerometer:
    """An accelerometer of a simulated robot."""

    def __init__(self, options: AccelerometerOptions, robot: RobotOptions, clock: Clock) -> None:
        assert isinstance(options, SimulatedAccelerometerOptions)
        assert isinstance(clock, SimulatedRobot)
        self._robot = clock
        self._bar = clock.add_sensor(options)
        self.range_ms2 = options.range_ms2

    def open(self) -> None:
        """Builds the model, which is compiled if it never was on this machine.  Raises DriverError."""
        self._robot.prepare()
        self._bar.is_read = True

    def identify(self) -> tuple[Identity, ...]:
        description = f"simulated accelerometer at {self._bar.options.rate_hz:g} Hz"
        return (Identity(self._bar.options.name, description, description, ok=True),)

    def read(self) -> AccelBlock:
        return next(iter(self._robot.collect([self._bar.blocks])), AccelBlock(np.empty(0), np.empty(0)))

    def close(self) -> None:
        """What is not read from now on is not kept."""
        self._bar.is_read = False
        self._bar.blocks.clear()


def check(robot: RobotOptions) -> None:
    """Raises DriverError for a motion that the model lacks or cannot follow, and where its packages are missing."""
    assert isinstance(robot, SimulatedOptions)
    for package in ("numba", "scipy"):
        if not is_there(package):
            raise DriverError(f"driver: {missing(package, 'the simulated robot')}")
    if robot.motion == "hand-waved":  # the usual case: spares the commands that read a configuration a second
        return
    from lostmotion.model import ModelError, by_name

    try:
        peaks = by_name(robot.motion).peaks()
    except ModelError as error:
        raise DriverError(f"simulated.motion: {error}") from error
    if max(peaks) > MOST_RATE:
        found = "{:.3g} rad/s and {:.3g} rad/s²".format(*peaks)
        raise DriverError(
            f"simulated.motion: {robot.motion!r} reaches {found}, expected at most {MOST_RATE:g} of each; no gear "
            "moves so fast"
        )


DRIVER = Driver(
    name="simulated",
    summary="the model as a robot: joints with play that grows, at any speed of time",
    servo=SimulatedJoints,
    accelerometer=SimulatedAccelerometer,
    joint_options=SimulatedJointOptions,
    accelerometer_options=SimulatedAccelerometerOptions,
    robot_options=SimulatedOptions,
    clock=SimulatedRobot,
    check=check,
)
