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
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime, timedelta
from operator import attrgetter
from typing import Protocol, TypeVar

import numpy as np

from lostmotion.drivers.base import (
    AccelBlock,
    AccelerometerOptions,
    Driver,
    FloatArray,
    Identity,
    JointOptions,
    RobotOptions,
    ServoReading,
    ServoSample,
)
from lostmotion.drivers.clock import Clock, VirtualClock
from lostmotion.drivers.errors import DriverError
from lostmotion.drivers.pacing import Pace, as_utc
from lostmotion.drivers.packages import is_there, missing
from lostmotion.drivers.schedule import YEAR_S, Step, grid, schedule_step, skips
from lostmotion.drivers.simulated_options import (
    MOST_PLAY_M,
    SimulatedAccelerometerOptions,
    SimulatedJointOptions,
    SimulatedOptions,
)

__all__ = ["DRIVER", "SimulatedAccelerometer", "SimulatedJoints", "SimulatedRobot"]

log = logging.getLogger(__name__)

T = TypeVar("T")

LONG_COMPILE_S = 2.0
STEP_S = 0.5
"""A step where time is skipped [s]."""
KNOT_S = 2e-3
MOST_WEAR = 100.0
"""Exponent of the wear, at which any gap has reached its largest, and exp does not overflow."""
MOST_RATE = 1e4
"""Velocity [rad/s] and acceleration [rad/s²] of a motion: thousands are a servo's best, and from 5e4 on teeth that meet
would take steps without number."""
RUN_UP_S = 1.5
"""Motion before a stretch that nobody sees [s]: gears and bar are then in the middle of it."""


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
        with self._made:
            begin = time.monotonic()
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
        if time.monotonic() - begin > LONG_COMPILE_S:
            log.info("the model was compiled in %.0f s; it is kept for the next start", time.monotonic() - begin)

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


class Motion(Protocol):
    """A motion of the model, which is not imported yet: an angle [rad] and its derivatives at times [s]."""

    def position(self, t: FloatArray) -> FloatArray: ...
    def velocity(self, t: FloatArray) -> FloatArray: ...
    def acceleration(self, t: FloatArray) -> FloatArray: ...


class Gear:
    """One joint: the base ``play`` with the gap of the day, or, without play, the bar alone on a gear that follows."""

    def __init__(self, options: SimulatedJointOptions, seed: int) -> None:
        self.options = options
        self.samples: deque[list[ServoSample]] = deque()
        self.is_read = True
        self._seed = seed
        self._motion = ""
        self._body: Playing | Rigid | None = None

    def play_m(self, robot_time: float) -> float:
        """The gap after so much operation [m]."""
        worn = min(self.options.wear_per_year * robot_time / YEAR_S, MOST_WEAR)
        return min(self.options.play_m * math.exp(worn), MOST_PLAY_M)

    def lever_ratio(self, bar: Bar) -> float:
        """The joint's lever arm at its accelerometer in lengths of the bar: the factor of the acceleration there."""
        length_m = bar.options.oscillator.length_m
        return self.options.levers_m.get(bar.options.name, length_m) / length_m

    def prepare(self, motion: str, bar: Bar | None) -> None:
        """Builds the model with the bar's oscillator on it, and runs it once.  Raises DriverError."""
        from lostmotion.model import ModelError

        if self._body is not None:
            return
        self._motion = motion
        try:
            body = (Playing if self.options.play_m else Rigid)(bar.oscillator if bar else {})
            body.begin(self._moves(0), -RUN_UP_S)
            body.move(np.array([-RUN_UP_S, 0.0]), self.options.play_m)
        except ModelError as error:
            raise DriverError(f"{self.options.name}: {error}") from error
        self._body = body

    def move(self, step: Step, accel_times: FloatArray) -> FloatArray:
        """Moves through a step, queues the servo's samples; the tip acceleration [m/s²] at these times [s].

        The model's time is that of the stretch: a large time has few digits left for the phase of a motion.
        """
        assert self._body is not None
        if step.after_rest:
            self._body.begin(self._moves(step.stretch), -RUN_UP_S)
        servo_times = grid(step.begin, step.servo_end, self.options.poll_hz)
        all_times = np.unique(np.concatenate([servo_times, accel_times]))
        times = np.concatenate([[self._body.time], all_times - step.origin])
        command, position, accel = (signal[1:] for signal in self._body.move(times, self.play_m(step.begin)))
        if self.is_read:
            at = np.searchsorted(all_times, servo_times)
            self.samples.append(self._servo_samples(servo_times, command[at], position[at]))
        return np.asarray(accel[np.searchsorted(all_times, accel_times)])

    def _moves(self, stretch: int) -> Motion:
        """The motion of a stretch; a hand never waves twice the same.  Raises ModelError."""
        from lostmotion.model import HandWaved, by_name

        return HandWaved(self._seed + 1000 * stretch) if self._motion == "hand-waved" else by_name(self._motion)

    def _servo_samples(self, times: FloatArray, command: FloatArray, position: FloatArray) -> list[ServoSample]:
        step = self.options.resolution_rad
        if step:
            command, position = np.round(command / step) * step, np.round(position / step) * step
        rows = zip(times.tolist(), command.tolist(), position.tolist(), strict=True)
        return [ServoSample(self.options.name, *row) for row in rows]


class Playing:
    """Gears with play and the bar on them: the model as it is."""

    def __init__(self, oscillator: Mapping[str, float]) -> None:
        from lostmotion.model import build_model

        self._model = build_model("play", values=oscillator)

    def begin(self, motion: Motion, time: float) -> None:
        """Moves along with that motion from that time [s] on."""
        self._motion, self.time = motion, time
        self._state = self._model.initial_state(motion, time)

    def move(self, times: FloatArray, play_m: float) -> tuple[FloatArray, FloatArray, FloatArray]:
        """command, position [rad] and tip acceleration [m/s²] at ``times`` [s], of which the first is where it stands.

        The gap widens in steps of 0.1 %, which is as good as steadily, and cheaper.
        """
        if abs(play_m / self._model.parameters["d"].value - 1) > 1e-3:
            self._model = self._model.replace({"d": play_m})
        moved = self._model.simulate(self._motion, times, self._state)
        self.time, self._state = float(times[-1]), moved.state
        return moved["command"], moved["position"], moved["accel"]


class Rigid:
    """A joint without play: theta_2 = theta_1 exactly, so that only the bar is left to be integrated.

    By eq. 7 that is an oscillator under the force -m l theta_1''; its tip accelerates by q'' + l theta_1''.
    """

    def __init__(self, oscillator: Mapping[str, float]) -> None:
        from lostmotion.model import build_model

        given = {name: value for name, value in oscillator.items() if name != "l"}
        self._model = build_model("oscillator", values=given)
        self._length = oscillator.get("l", 0.1)

    def begin(self, motion: Motion, time: float) -> None:
        """Moves along with that motion from that time [s] on."""
        self._motion, self.time, self._state = motion, time, np.zeros(2)

    def move(self, times: FloatArray, play_m: float) -> tuple[FloatArray, FloatArray, FloatArray]:
        """As Playing's."""
        from lostmotion.model import Sampled

        knots = np.arange(times[0] - KNOT_S, times[-1] + 3 * KNOT_S, KNOT_S)
        force = -self._model.parameters["m"].value * self._length * self._motion.acceleration(knots)
        moved = self._model.simulate(Sampled(knots, force), times, self._state)
        self.time, self._state = float(times[-1]), moved.state
        angle = self._motion.position(times)
        return angle, angle, moved["accel"] + self._length * self._motion.acceleration(times)


class Bar:
    """One accelerometer at the end of its metal bar."""

    def __init__(self, options: SimulatedAccelerometerOptions, seed: Sequence[int]) -> None:
        self.options = options
        self.blocks: deque[AccelBlock] = deque()
        self.is_read = True
        self._rng = np.random.default_rng(seed)

    def times(self, step: Step) -> FloatArray:
        """When it samples in a step [s]."""
        return grid(step.begin, step.end, self.options.rate_hz)

    @property
    def oscillator(self) -> dict[str, float]:
        """The bar as parameters of the model; the mass itself makes no difference to the acceleration."""
        bar, mass = self.options.oscillator, 0.02
        omega = 2 * math.pi * bar.f_res_hz
        return {"m": mass, "k": mass * omega**2, "b": 2 * bar.zeta * mass * omega, "l": bar.length_m}

    def feel(self, step: Step, tip: FloatArray) -> None:
        """Queues the readings of a step for the true tip acceleration [m/s²]."""
        from lostmotion.model import Sensor

        options = self.options
        sensor = Sensor(noise=options.noise_ms2, resolution=options.resolution_ms2, range=options.range_ms2)
        readings = sensor.apply(tip, self._rng)
        if self.is_read:
            self.blocks.append(AccelBlock(self.times(step), readings))


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
