"""The driver of ROS 2 against a robot on a Zenoh router of its own, which publishes with rosbags."""

from __future__ import annotations

import logging
import time
from collections.abc import Iterator
from typing import Any

import msgspec
import numpy as np
import pytest

from lostmotion.drivers.base import Accelerometer, Identity, ServoBus
from lostmotion.drivers.clock import SystemClock
from lostmotion.drivers.emulator import Motion
from lostmotion.drivers.emulator.ros2 import Ros2Robot
from lostmotion.drivers.errors import DriverError, PortError
from lostmotion.drivers.ros2 import DRIVER
from tests.daemon.conftest import wait_until
from tests.daemon.zenoh_world import session
from tests.drivers.rigs import readings, some

MOTION = Motion()
ROBOT: dict[str, Any] = {"motion": MOTION, "imu_hz": 250.0}


@pytest.fixture
def robot() -> Iterator[Ros2Robot]:
    """Two joints at 100 Hz and an Imu at 250 Hz."""
    with Ros2Robot(**ROBOT) as made:
        yield made


def bus(robot: Ros2Robot, *joints: dict[str, Any], **network: Any) -> ServoBus:
    """Joints of this robot; by default joint0."""
    options = [
        msgspec.convert({"name": f"joint{i}", "driver": "ros2", "accelerometer": "tip", **keys}, DRIVER.joint_options)
        for i, keys in enumerate(joints or ({},))
    ]
    assert DRIVER.servo
    settings = msgspec.convert({"connect": list(robot.paths), **network}, DRIVER.robot_options)
    return DRIVER.servo(options, settings, SystemClock())


def sensor(robot: Ros2Robot, **keys: Any) -> Accelerometer:
    """The accelerometer of this robot."""
    table = {"name": "tip", "driver": "ros2", "topic": "/imu", "rate_hz": 250, "oscillator": {"f_res_hz": 58.0}}
    options = msgspec.convert(table | keys, DRIVER.accelerometer_options)
    assert DRIVER.accelerometer
    settings = msgspec.convert({"connect": list(robot.paths)}, DRIVER.robot_options)
    return DRIVER.accelerometer(options, settings, SystemClock())


def identities(device: ServoBus | Accelerometer) -> tuple[Identity, ...]:
    """Who is heard, by a session of its own."""
    device.open()
    try:
        return device.identify()
    finally:
        device.close()


class NotedMotion(Motion):
    """Keeps when it was asked for a goal [s], by the goal."""

    def __init__(self) -> None:
        super().__init__()
        self.moments: dict[float, float] = {}

    def goal(self, time: float) -> float:
        goal = super().goal(time)
        self.moments[goal] = time
        return goal


@pytest.mark.parametrize("layout", ["old", "new"])
def test_the_controller_tells_command_and_position(layout: Any) -> None:
    """Both angles are those of one instant of the motion, whichever the message's layout, and the sample's time is that
    instant, to 20 ms where the machine is not busy."""
    motion = NotedMotion()
    with Ros2Robot(motion, imu_hz=250.0, layout=layout) as robot:
        device = bus(robot, {"joint": "joint1", "reference": "/controller_state"})
        device.open()
        (who,) = device.identify()
        found = readings(device, some(50, "joint0"))
        device.close()
    assert who.ok
    assert "the controller's reference" in who.found
    assert device.resolution_rad == 0.0
    samples = [sample for reading in found for sample in reading.samples]
    instants = [motion.moments[sample.command] for sample in samples]
    assert [sample.position for sample in samples] == [motion.position(instant) for instant in instants]
    late = [sample.time - instant for sample, instant in zip(samples, instants, strict=True)]
    assert -0.02 < min(late) < 0.02
    assert np.median(np.diff([sample.time for sample in samples])) == pytest.approx(0.01, rel=0.2)


def test_a_measured_command_is_said(robot: Ros2Robot) -> None:
    """Without a reference the measured position is the command, and the identity says so."""
    device = bus(robot)
    device.open()
    (who,) = device.identify()
    samples = device.read().samples
    device.close()
    assert "commanded: the measured position, as no controller's reference is given" in who.found
    assert samples
    assert all(sample.command == sample.position for sample in samples)


def test_joints_share_one_subscriber(robot: Ros2Robot) -> None:
    """Two joints on a topic are told by the same messages: same instants, one session."""
    device = bus(robot, {}, {})
    device.open()
    found = readings(device, some(1, "joint0", "joint1"))
    device.close()
    times = {name: [s.time for r in found for s in r.samples if s.joint == name] for name in ("joint0", "joint1")}
    assert times["joint0"] == times["joint1"]


def test_nothing_is_published(robot: Ros2Robot) -> None:
    """Another session at the same router hears no message and no token of the driver's."""
    with session("client", connect=list(robot.paths)) as other:
        robot.silent = True
        time.sleep(0.2)
        heard: list[Any] = []
        other.declare_subscriber("**", heard.append)
        device = bus(robot)
        device.open()
        before = sorted(str(reply.ok.key_expr) for reply in other.liveliness().get("@ros2_lv/**") if reply.ok)
        for _ in range(3):
            device.read()
        device.close()
    assert heard == []
    assert len(before) == 3
    assert all("/MP/" in token for token in before)


def test_an_unknown_joint_is_told_with_those_there_are(robot: Ros2Robot) -> None:
    """The names on the topic stand in the error; the other joint is well."""
    wrong, right = identities(bus(robot, {"joint": "elbow_joint"}, {}))
    assert (wrong.ok, right.ok) == (False, True)
    assert wrong.found == "no joint 'elbow_joint' on /joint_states; there are joint0, joint1"


@pytest.mark.slow
def test_a_topic_that_never_comes(robot: Ros2Robot) -> None:
    """Fitting topics are listed; where a node would publish, its hardware is the likely cause."""
    (who,) = identities(bus(robot, {"topic": "/arm/joint_states"}))
    assert who.found.startswith(
        "no message on /arm/joint_states in 2.5 s; there are /controller_state, /joint_states; "
    )
    robot.silent = True
    (who,) = identities(sensor(robot))
    assert "though /robot would publish it; likely cause: its hardware or controller is not active" in who.found


def test_a_wrong_type_is_told(robot: Ros2Robot) -> None:
    """An Imu's topic given for a joint's, and the other way round."""
    (who,) = identities(bus(robot, {"topic": "/imu"}))
    assert not who.ok
    assert who.found.startswith("sensor_msgs/msg/Imu on /imu, which is none of sensor_msgs/msg/JointState")
    (who,) = identities(sensor(robot, topic="/joint_states"))
    assert who.found.startswith("sensor_msgs/msg/JointState on /joint_states, which is none of sensor_msgs/msg/Imu")


def test_two_publishers_are_told(robot: Ros2Robot) -> None:
    """The same joint, or one Imu, from two publishers is no data."""
    robot.twice = True
    (joint,), (tip,) = identities(bus(robot)), identities(sensor(robot))
    assert not joint.ok
    assert not tip.ok
    assert "2 publishers of joint 'joint0' on /joint_states (/robot); expected one" in joint.found
    assert "2 publishers of one Imu on /imu" in tip.found


def test_a_wrong_rate_is_told(robot: Ros2Robot) -> None:
    """250 Hz where the configuration says 400."""
    (who,) = identities(sensor(robot, rate_hz=400))
    assert not who.ok
    assert "rate_hz is not what the sensor's node publishes" in who.found


def test_stamps_of_zero_leave_the_publisher_time(robot: Ros2Robot, caplog: pytest.LogCaptureFixture) -> None:
    """The attachment's time serves, which the identity and the log say; times ascend evenly."""
    robot.stamps = "zero"
    device = sensor(robot)
    device.open()
    with caplog.at_level(logging.WARNING):
        for _ in range(5):  # a publisher that is held up sends late, and then sooner
            (who,) = device.identify()
            times = np.concatenate([device.read().time for _ in range(40)])
            if who.ok and np.median(np.diff(times)) == pytest.approx(0.004, rel=0.1):
                break
    device.close()
    assert who.ok
    assert "the publisher's time, as the header's stamps are 0" in who.found
    assert "/imu: times are the publisher's time, as the header's stamps are 0" in caplog.text
    assert np.diff(times).min() > 0
    assert np.median(np.diff(times)) == pytest.approx(0.004, rel=0.1)


def test_simulated_time(robot: Ros2Robot) -> None:
    """At real time's speed it serves, and is said; at half the speed it is refused."""
    robot.stamps = "simulated"
    (who,) = identities(bus(robot))
    assert (who.ok, "simulated time" in who.found) == (True, True), who.found
    robot.pace = 0.5
    (who,) = identities(bus(robot))
    assert not who.ok
    assert "likely cause: simulated time (use_sim_time) at another speed" in who.found


@pytest.mark.parametrize("jump_s", [3600.0, -3600.0])
def test_stamps_that_jump(robot: Ros2Robot, jump_s: float, caplog: pytest.LogCaptureFixture) -> None:
    """Robot times go on, near the host's, and the log says by how much the stamps jumped."""
    device = bus(robot)
    device.open()
    samples = [sample for _ in range(6) for sample in device.read().samples]
    robot.ahead_s = jump_s
    with caplog.at_level(logging.WARNING):
        samples += [sample for _ in range(15) for sample in device.read().samples]
    device.close()
    times = np.array([sample.time for sample in samples])
    assert np.diff(times).min() > 0
    assert abs(time.monotonic() - times[-1]) < 60
    assert f"the clock of the stamps jumped by {jump_s:+.3g} s" in caplog.text


def test_the_router_vanishes_and_comes_back(robot: Ros2Robot) -> None:
    """PortError while it is away, also on opening; afterwards data, at later times."""
    device = bus(robot)
    device.open()
    before = device.read().samples[-1].time
    robot.unplug()
    with pytest.raises(PortError, match="went away"):
        read_on(device)
    with pytest.raises(PortError, match="nobody answers at tcp/127"):
        device.open()
    with pytest.raises(PortError, match="is not open"):
        device.read()
    robot.plug()
    device.open()
    assert device.identify()[0].ok
    assert device.read().samples[0].time > before
    device.close()
    device.close()


def read_on(device: ServoBus) -> None:
    """Ten seconds at most."""
    for _ in range(40):
        device.read()


def test_silence_is_told(robot: Ros2Robot) -> None:
    """A topic that falls silent gives readings without samples, soon; its joints are silent."""
    device = bus(robot)
    device.open()
    device.read()
    robot.silent = True
    wait_until(lambda: device.read().samples == ())
    spans = []
    for _ in range(5):
        start = time.monotonic()
        assert device.read().silent == ("joint0",)
        spans.append(time.monotonic() - start)
    assert min(spans) < 1.0
    device.close()


def test_axis_and_range(robot: Ros2Robot) -> None:
    """The z axis shows gravity, turned by a minus; what is beyond the range is NaN."""
    device = sensor(robot, axis="-z")
    device.open()
    assert np.unique(device.read().accel).tolist() == [-9.80665]
    device.close()
    device = sensor(robot, axis="z", range_ms2=5.0)
    device.open()
    assert np.isnan(device.read().accel).all()
    device.close()


def test_namespace_and_domain() -> None:
    """A topic without a slash stands in the namespace; another domain is not heard."""
    with Ros2Robot(**ROBOT, domain=5, namespace="left") as robot:
        (who,) = identities(bus(robot, {"topic": "joint_states"}, domain_id=5, namespace="/left"))
        assert who.ok
        (who,) = identities(bus(robot, {"topic": "/left/joint_states"}))
        assert "no topic of a fitting type; likely cause: another name, namespace or domain_id" in who.found


def test_behind_a_bridge() -> None:
    """Keys of zenoh-bridge-ros2dds have neither domain nor type; the messages are the same."""
    with Ros2Robot(**ROBOT, bridge=True) as robot:
        device = bus(robot, {}, {"reference": "/controller_state"}, bridge="ros2dds")
        device.open()
        who = device.identify()
        samples = device.read().samples
        device.close()
        (missing,) = identities(bus(robot, {"topic": "/nothing"}, bridge="ros2dds"))
    assert [one.ok for one in who] == [True, True], who
    assert {sample.joint for sample in samples} == {"joint0", "joint1"}
    assert "there are /controller_state, /joint_states" in missing.found


def test_a_joint_given_twice_is_refused(robot: Ros2Robot) -> None:
    """Two joints of the configuration with one name on one topic."""
    with pytest.raises(DriverError, match="'joint0' on /joint_states already belongs to joint 'joint0'"):
        bus(robot, {}, {"joint": "joint0"})
