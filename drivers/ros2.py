"""Driver of joints and accelerometers that a robot publishes on topics of ROS 2, over rmw_zenoh.

It only listens: nothing is published, and the bus of the servos is left to ros2_control.  The session is in
``ros2_session.py``, messages in ``codec/ros2_messages.py``, identities in ``ros2_identity.py``.
"""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Iterable, Sequence
from typing import Literal

import numpy as np

from lostmotion.drivers.base import (
    AccelBlock,
    Accelerometer,
    AccelerometerOptions,
    Driver,
    FloatArray,
    Identity,
    JointOptions,
    RobotOptions,
    ServoBus,
    ServoReading,
    ServoSample,
)
from lostmotion.drivers.clock import Clock
from lostmotion.drivers.clockmap import ClockMap
from lostmotion.drivers.codec.cdr import CdrError
from lostmotion.drivers.codec.rmw_zenoh import qualified
from lostmotion.drivers.codec.ros2_messages import (
    CONTROLLER_STATE,
    DECODERS,
    IMU,
    JOINT_STATE,
    JointStates,
    imu_acceleration,
)
from lostmotion.drivers.errors import DriverError
from lostmotion.drivers.ros2_identity import REFERENCE, Wanted, decoded, identify_all
from lostmotion.drivers.ros2_session import Listener, Message, Ros2Network
from lostmotion.drivers.ros2_stamps import Source, stamped
from lostmotion.drivers.sensor_rate import check_rate
from lostmotion.drivers.timeline import Timeline

__all__ = ["DRIVER", "Ros2AccelerometerOptions", "Ros2JointOptions"]

log = logging.getLogger(__name__)

GATHER_S = 0.095
"""messages of joints are looked at together for so long [s]: right after a wait each costs far more"""
WAIT_S = 0.25
ARRIVAL_S = 0.4
"""how often the arrival of a message is watched [s]: of each half second the quickest counts"""
AXES = {"x": 1, "y": 2, "z": 3}
NOTHING = np.empty(0)


class Ros2JointOptions(JointOptions, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """topic: of a JointState, DynamicJointState or JointTrajectoryControllerState; joint: its name there, if it is
    not ``name``; reference: the topic of the controller's state, of which then both the commanded and the measured
    angle are taken, instead of ``topic``."""

    topic: str = "/joint_states"
    joint: str = ""
    reference: str = ""


class Ros2AccelerometerOptions(AccelerometerOptions, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """topic: of an Imu; axis: the one that points along the motion of the bar's free end; range_ms2: the largest
    acceleration the sensor can show [m/s²]."""

    topic: str
    axis: Literal["x", "y", "z", "-x", "-y", "-z"] = "x"
    range_ms2: float = math.inf


class Ros2Bus:
    """All joints, whichever topics they are on, over one session; see ``base.ServoBus``."""

    def __init__(self, joints: Sequence[Ros2JointOptions], network: Ros2Network, clock: Clock) -> None:
        self._clock = clock
        self._joints: dict[str, dict[str, str]] = {}
        for joint in joints:
            topic = qualified(joint.reference or joint.topic, network.namespace)
            same = self._joints.setdefault(topic, {})
            ros_name = joint.joint or joint.name
            if ros_name in same:
                raise DriverError(
                    f"joint {joint.name!r}: {ros_name!r} on {topic} already belongs to joint {same[ros_name]!r}"
                )
            same[ros_name] = joint.name
        self._controlled = {joint.name for joint in joints if joint.reference}
        self._names = tuple(joint.name for joint in joints)
        controlled = {qualified(joint.reference, network.namespace) for joint in joints if joint.reference}
        bridged = {topic: CONTROLLER_STATE if topic in controlled else JOINT_STATE for topic in self._joints}
        self._listener = Listener(network, bridged)
        self.resolution_rad = math.nan
        self._last = dict.fromkeys(self._names, -math.inf)
        self._silent_since = dict.fromkeys(self._names, math.inf)
        self._times: dict[str, TopicTimes] = {}

    def open(self) -> None:
        """Connects to the router.  Raises PortError."""
        self._listener.open()
        self._times = {topic: TopicTimes(topic) for topic in self._joints}
        self._silent_since = dict.fromkeys(self._names, self._clock.now())

    def identify(self) -> tuple[Identity, ...]:
        """Listens until each topic has shown its type, joints, rate and clock.  Raises PortError."""
        wanted = [
            Wanted(name, topic, ros_name, tuple(DECODERS), name in self._controlled)
            for topic, joints in self._joints.items()
            for ros_name, name in joints.items()
        ]
        found = {who.name: who for who in identify_all(self._listener, wanted, self._clock.now)}
        commanded = {who.name for who in found.values() if who.ok and who.found.endswith(REFERENCE)}
        self.resolution_rad = 0.0 if commanded == set(self._names) else math.nan
        return tuple(found[name] for name in self._names)

    def read(self) -> ServoReading:
        """The samples of 0.1 s; waits for some up to 0.25 s.  Raises PortError when the router went away."""
        end = self._clock.now() + WAIT_S
        time.sleep(GATHER_S)
        samples, broken = self._samples()
        while not samples and self._clock.now() < end:
            time.sleep(0.01)
            samples, more = self._samples()
            broken += more
        if not samples:
            self._listener.check()
            return ServoReading(silent=self._names, broken=broken)
        samples.sort(key=lambda sample: sample.time)
        now = self._clock.now()
        self._silent_since.update(dict.fromkeys((sample.joint for sample in samples), now))
        silent = tuple(name for name, since in self._silent_since.items() if now - since > 4 * GATHER_S)
        return ServoReading(tuple(samples), silent, broken=broken)

    def close(self) -> None:
        """Gives the session back."""
        self._listener.close()

    def _samples(self) -> tuple[list[ServoSample], int]:
        """What has come on all topics, and how many messages or joints' values were broken."""
        samples, broken = list[ServoSample](), 0
        for topic, joints in self._joints.items():
            times = self._times[topic]
            messages = times.received(self._listener, self._clock)
            arrival = self._clock.now()
            states: list[JointStates] = []
            attached: list[bytes] = []
            for message in messages:
                try:
                    states.append(decoded(message))
                    attached.append(message.attached)
                except CdrError:
                    broken += 1
            host = times.host([(one.stamp_ns, more) for one, more in zip(states, attached, strict=True)], arrival)
            for one, moment in zip(states, host, strict=True):
                broken += self._add(one, moment, joints, samples)
        return samples, broken

    def _add(self, states: JointStates, moment: float, joints: dict[str, str], samples: list[ServoSample]) -> int:
        """Puts the joints of a message to the samples; how many of them had no angle."""
        broken = 0
        for index, name in enumerate(states.names):
            joint = joints.get(name)
            if joint is None or moment <= self._last[joint]:
                continue
            position = states.position[index] if states.position else math.nan
            command = states.reference[index] if states.reference else position
            if not math.isfinite(command):
                broken += 1
                continue
            self._last[joint] = moment
            velocity = states.velocity[index] if states.velocity else math.nan
            torque = states.effort[index] if states.effort else math.nan
            samples.append(ServoSample(joint, moment, command, position, velocity, torque))
        return broken


class Ros2Accelerometer:
    """One axis of an Imu on a topic, over a session of its own; see ``base.Accelerometer``."""

    def __init__(self, options: Ros2AccelerometerOptions, network: Ros2Network, clock: Clock) -> None:
        """Raises DriverError when the rate is too low for the oscillator."""
        check_rate(options)
        self.range_ms2 = options.range_ms2
        self._name, self._rate, self._clock = options.name, options.rate_hz, clock
        self._topic = qualified(options.topic, network.namespace)
        self._index = AXES[options.axis[-1]]
        self._sign = -1.0 if options.axis.startswith("-") else 1.0
        self._listener = Listener(network, {self._topic: IMU})
        self._times = TopicTimes(self._topic)
        self._timeline: Timeline | None = None
        self._counts = False

    def open(self) -> None:
        """Connects to the router.  Raises PortError."""
        self._listener.open()
        self._times, self._timeline = TopicTimes(self._topic), None

    def identify(self) -> tuple[Identity, ...]:
        """Listens until the topic has shown its type, rate and clock.  Raises PortError."""
        wanted = Wanted(self._name, self._topic, "", (IMU,), rate_hz=self._rate)
        found = identify_all(self._listener, [wanted], self._clock.now)
        self._listener.take(self._topic)
        return tuple(found)

    def read(self) -> AccelBlock:
        """The samples since the last call; waits for some up to 0.25 s.  Raises PortError when the router went away."""
        messages = self._times.received(self._listener, self._clock) or self._listener.wait(self._topic, WAIT_S)
        arrival = self._clock.now()
        if not messages:
            self._listener.check()
            return AccelBlock(NOTHING, NOTHING)
        accel, stamps, broken = list[float](), list[float](), 0
        for message in messages:
            try:
                if message.type != IMU:
                    raise CdrError(f"found {message.type}, expected {IMU}")
                sample = imu_acceleration(message.data)
            except CdrError:
                broken += 1
                continue
            value = self._sign * sample[self._index]
            accel.append(value if abs(value) <= self.range_ms2 else math.nan)
            stamps.append(self._times.stamp(sample[0], message.attached))
        if not accel:
            return AccelBlock(NOTHING, NOTHING, broken=broken)
        return self._block(np.array(stamps), np.array(accel), arrival, broken)

    def close(self) -> None:
        """Gives the session back."""
        self._listener.close()

    def _block(self, stamps: FloatArray, accel: FloatArray, arrival: float, broken: int) -> AccelBlock:
        """In robot time: by the stamps, or by counting where there are none."""
        if self._timeline is None:
            self._timeline = Timeline(1 / self._rate, None if math.isnan(stamps[0]) else math.inf)
            self._counts = math.isnan(stamps[0])
        if self._counts:
            return self._timeline.counted(accel, arrival, broken)
        known = np.isfinite(stamps)
        if not known.any():
            return AccelBlock(NOTHING, NOTHING, broken=broken + len(accel))
        return self._timeline.stamped(stamps[known], accel[known], arrival, broken + int(np.count_nonzero(~known)))


class TopicTimes:
    """The times of the messages of one topic: stamps counted from the first one, mapped to the host's clock."""

    def __init__(self, topic: str) -> None:
        self._topic = topic
        self._map = ClockMap()
        self._origin = math.nan
        self._source: Source | None = None
        self._watched = -math.inf
        self._logged_steps = 0

    def received(self, listener: Listener, clock: Clock) -> list[Message]:
        """The messages that have come; now and then those up to one whose arrival was seen."""
        if clock.now() < self._watched + ARRIVAL_S:
            return listener.take(self._topic)
        self._watched = clock.now()
        return listener.wait(self._topic, GATHER_S / 2)

    def stamp(self, header_ns: int, attached: bytes) -> float:
        """A message's time [s] since the first one's, NaN where only its arrival is known; the clock is logged."""
        seconds, source = stamped(header_ns, attached)
        if source is not self._source:
            if self._source is not None:
                self._map.forget()
                self._origin = math.nan
            self._source = source
            level = logging.INFO if source is Source.HEADER else logging.WARNING
            log.log(level, "%s: times are %s", self._topic, source.value)
        if math.isnan(self._origin):
            self._origin = seconds
        return seconds - self._origin

    def host(self, messages: Iterable[tuple[int, bytes]], arrival: float) -> list[float]:
        """Robot times [s] of messages (header's stamp, attachment), the last of which came at ``arrival``."""
        run, found = list[float](), list[float]()
        for header_ns, attached in messages:
            stamp = self.stamp(header_ns, attached)
            if math.isnan(stamp):
                found.append(arrival)
                continue
            if run and stamp <= run[-1]:  # two publishers, or a clock that was set
                found += self._mapped(run, arrival)
                run = []
            run.append(stamp)
        return found + (self._mapped(run, arrival) if run else [])

    def _mapped(self, run: list[float], arrival: float) -> list[float]:
        host = self._map.feed(np.array(run), arrival).tolist()
        if self._map.steps > self._logged_steps:
            self._logged_steps = self._map.steps
            log.warning("%s: the clock of the stamps jumped by %+.3g s; times go on", self._topic, -self._map.step)
        return list(host)


def _make_bus(joints: Sequence[JointOptions], robot: RobotOptions, clock: Clock) -> ServoBus:
    assert isinstance(robot, Ros2Network)
    return Ros2Bus([joint for joint in joints if isinstance(joint, Ros2JointOptions)], robot, clock)


def _make_sensor(options: AccelerometerOptions, robot: RobotOptions, clock: Clock) -> Accelerometer:
    assert isinstance(options, Ros2AccelerometerOptions)
    assert isinstance(robot, Ros2Network)
    return Ros2Accelerometer(options, robot, clock)


DRIVER = Driver(
    name="ros2",
    summary="topics of ROS 2 over rmw_zenoh: joint or controller states, Imu; publishes nothing",
    servo=_make_bus,
    accelerometer=_make_sensor,
    joint_options=Ros2JointOptions,
    accelerometer_options=Ros2AccelerometerOptions,
    robot_options=Ros2Network,
)
