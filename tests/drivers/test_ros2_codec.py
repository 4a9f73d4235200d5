"""CDR and rmw_zenoh's keys, against rosbags' bytes and hashes; broken bytes are refused in one line."""

from __future__ import annotations

import math
import os
from contextlib import suppress
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lostmotion.drivers.codec import rmw_zenoh
from lostmotion.drivers.codec.cdr import CdrError
from lostmotion.drivers.codec.ros2_messages import DECODERS, JointStates, imu_acceleration
from lostmotion.drivers.emulator.ros2 import STATE, typestore

EXAMPLES = int(os.environ.get("LOSTMOTION_EXAMPLES", "400"))
STORES = {"old": typestore("old"), "new": typestore("new")}
ROS = STORES["new"]
TYPES = ROS.types
JOINT_STATE, DYNAMIC = "sensor_msgs/msg/JointState", "control_msgs/msg/DynamicJointState"
IMU = "sensor_msgs/msg/Imu"
names = st.lists(st.text(st.characters(codec="utf-8", exclude_characters="\0"), max_size=9), max_size=7)
seeds = st.integers(0, 2**32 - 1)
seconds, fractions = st.integers(-(2**31), 2**31 - 1), st.integers(0, 999_999_999)
frames = st.text(max_size=9)
orders = st.booleans()


def header(sec: int, nanosec: int, frame: str) -> Any:
    """A std_msgs/Header."""
    return TYPES["std_msgs/msg/Header"](TYPES["builtin_interfaces/msg/Time"](sec, nanosec), frame.replace("\0", ""))


def written(message: Any, kind: str, is_little: bool, layout: str = "new") -> bytes:
    """The message as rosbags writes it."""
    return bytes(STORES[layout].serialize_cdr(message, kind, little_endian=is_little))


@settings(max_examples=EXAMPLES, deadline=None)
@given(seconds, fractions, frames, names, seeds, st.tuples(*[st.booleans()] * 3), orders)
def check_joint_states(
    sec: int, nanosec: int, frame: str, joints: list[str], seed: int, told: tuple[bool, ...], is_little: bool
) -> None:
    values = np.random.default_rng(seed).normal(size=(3, len(joints)))
    given = [row if keep else np.empty(0) for row, keep in zip(values, told, strict=True)]
    data = written(TYPES[JOINT_STATE](header(sec, nanosec, frame), joints, *given), JOINT_STATE, is_little)
    expected = JointStates(sec * 10**9 + nanosec, tuple(joints), *(tuple(row.tolist()) for row in given))
    assert DECODERS[JOINT_STATE](data) == expected


@settings(max_examples=EXAMPLES, deadline=None)
@given(seconds, fractions, frames, seeds, orders)
def check_imus(sec: int, nanosec: int, frame: str, seed: int, is_little: bool) -> None:
    x = np.random.default_rng(seed).normal(size=37)
    vector = TYPES["geometry_msgs/msg/Vector3"]
    message = TYPES[IMU](
        header(sec, nanosec, frame), TYPES["geometry_msgs/msg/Quaternion"](*x[:4]), x[4:13], vector(*x[13:16]),
        x[16:25], vector(*x[25:28]), x[28:],
    )  # fmt: skip
    told = imu_acceleration(written(message, IMU, is_little))
    assert told == (sec * 10**9 + nanosec, *x[25:28].tolist())


@settings(max_examples=EXAMPLES, deadline=None)
@given(frames, names, seeds, orders, st.sampled_from(["old", "new"]))
def check_controllers(frame: str, joints: list[str], seed: int, is_little: bool, layout: str) -> None:
    x = np.random.default_rng(seed).normal(size=(4, len(joints)))
    none, rest = np.empty(0), TYPES["builtin_interfaces/msg/Duration"](1, 2)
    point = TYPES["trajectory_msgs/msg/JointTrajectoryPoint"]
    points = [point(x[i], x[3 - i], x[i], none, rest) for i in range(4)]
    fields = points[:3] if layout == "old" else [*points, joints]
    message = STORES[layout].types[STATE](header(5, 6, frame), joints, *fields)
    told = DECODERS[STATE](written(message, STATE, is_little, layout))
    assert told.names == tuple(joints)
    assert told.reference == tuple(x[0])
    assert told.position == tuple(x[1])
    assert told.velocity == tuple(x[2])


@settings(max_examples=EXAMPLES, deadline=None)
@given(st.sampled_from([*DECODERS.values(), imu_acceleration]), st.binary(max_size=300), seeds)
def check_any_bytes(decode: Any, data: bytes, seed: int) -> None:
    for head in (b"", b"\x00\x01\x00\x00", b"\x00\x00\x00\x00"):
        with suppress(CdrError):
            decode(head + data)


@pytest.mark.slow
@pytest.mark.parametrize("check", [check_joint_states, check_imus, check_controllers, check_any_bytes])
def test_against_rosbags(check: Any) -> None:
    """1.1e5 messages of both byte orders say what rosbags wrote; any bytes at all are read, or refused in one line."""
    check()


@pytest.mark.parametrize("kind", [JOINT_STATE, STATE, DYNAMIC, IMU])
@pytest.mark.parametrize("is_little", [True, False])
def test_every_truncation_is_refused(kind: str, is_little: bool) -> None:
    """A message that ends too soon is refused wherever it ends, as long as what is read is touched."""
    data, needed = example(kind, is_little)
    decode = imu_acceleration if kind == IMU else DECODERS[kind]
    decode(data[:needed])
    for length in range(needed):
        with pytest.raises(CdrError, match=r"in the middle of a value|header of CDR"):
            decode(data[:length])


def example(kind: str, is_little: bool) -> tuple[bytes, int]:
    """A message of two joints, and how many of its bytes are read."""
    x, head = np.arange(2.0), header(5, 6, "base")
    if kind == JOINT_STATE:
        data = written(TYPES[kind](head, ["a", "bc"], x, x, x), kind, is_little)
        return data, len(data)
    if kind == DYNAMIC:
        each = [TYPES["control_msgs/msg/InterfaceValue"](["velocity", "position"], x + i) for i in range(2)]
        data = written(TYPES[kind](head, ["a", "bc"], each), kind, is_little)
        return data, len(data)
    if kind == STATE:
        rest = TYPES["builtin_interfaces/msg/Duration"](0, 0)
        point = TYPES["trajectory_msgs/msg/JointTrajectoryPoint"](x, x, x, x, rest)
        data = written(TYPES[kind](head, ["a", "bc"], *[point] * 4, []), kind, is_little)
        return data, len(data) - 212  # two points of 104 bytes, and the count of no names, are not read
    vector, zeros = TYPES["geometry_msgs/msg/Vector3"](0.0, 0.0, 0.0), np.zeros(9)
    turned = TYPES["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0)
    data = written(TYPES[kind](head, turned, zeros, vector, zeros, vector, zeros), kind, is_little)
    return data, len(data)


def test_dynamic_joint_states() -> None:
    """Interfaces in any order; one that a joint lacks is NaN."""
    told = DECODERS[DYNAMIC](example(DYNAMIC, True)[0])
    assert (told.names, told.position, told.velocity) == (("a", "bc"), (1.0, 2.0), (0.0, 1.0))
    assert all(math.isnan(effort) for effort in told.effort)


def test_a_value_too_few_is_refused() -> None:
    """Two joints and one position belong to nobody."""
    data = written(TYPES[JOINT_STATE](header(0, 0, ""), ["a", "b"], *[np.zeros(1)] * 3), JOINT_STATE, True)
    with pytest.raises(CdrError, match="found 1 values, expected 2"):
        DECODERS[JOINT_STATE](data)


def test_keys_are_those_of_the_design_page() -> None:
    """Slashes stay in a message's key, and become % in a token; a bridge's token has § for them."""
    hash = ROS.hash_rihs01(JOINT_STATE)
    key = rmw_zenoh.data_key(7, "/arm/joint_states", JOINT_STATE, hash)
    assert key == f"7/arm/joint_states/sensor_msgs::msg::dds_::JointState_/{hash}"
    assert rmw_zenoh.every_type_key(7, "/arm/joint_states") == "7/arm/joint_states/*/*"
    assert rmw_zenoh.qualified("imu", "/arm/") == "/arm/imu"
    assert rmw_zenoh.qualified("/imu", "arm") == "/imu"
    token = f"@ros2_lv/7/abc/0/11/MP/%/%arm/talker/%arm%imu/sensor_msgs::msg::dds_::Imu_/{hash}/::,7:,:,:,,"
    assert rmw_zenoh.endpoint(token) == rmw_zenoh.Endpoint("/arm/imu", IMU, "/arm/talker")
    bridged = rmw_zenoh.endpoint("@/abc/@ros2_lv/MP/arm§imu/sensor_msgs§msg§Imu/:::,1")
    assert bridged == rmw_zenoh.Endpoint("/arm/imu", IMU)
    assert rmw_zenoh.endpoint("@ros2_lv/7/abc/0/0/NN/%/%/talker") is None
    assert rmw_zenoh.sent(rmw_zenoh.attachment(5, 6, bytes(16))) == rmw_zenoh.Sent(5, 6, bytes(16))
    assert rmw_zenoh.sent(b"") is None
