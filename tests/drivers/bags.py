"""Bags that rosbags and mcap write: two joints with a controller, an Imu, a type of somebody's own, and JSON."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from mcap.writer import IndexType
from mcap.writer import Writer as McapWriter
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as BagWriter
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from lostmotion.drivers.emulator.ros2 import STATE, typestore

START_NS = 1_700_000_000_123_456_789
LATE_NS = 3_000_000
"""between a header's stamp and receipt"""
JOINT_S, IMU_S, COUNT = 0.01, 0.002, 100
JOINTS = ["elbow", "wrist"]
OWN = "acme_msgs/msg/Load"
OWN_TEXT = "std_msgs/Header header\nstring[] name\nfloat64[] torque\nuint8[] picture\n"
STORE = typestore("new")
STORE.register(get_types_from_msg(OWN_TEXT, OWN))
ROS1 = get_typestore(Stores.ROS1_NOETIC)
ROS1.register(get_types_from_msg("Header header\nfloat64 current\n", "acme_msgs/msg/Drive"))
TYPES = {
    "/joint_states": "sensor_msgs/msg/JointState",
    "/arm_controller/controller_state": STATE,
    "/imu": "sensor_msgs/msg/Imu",
    "/load": OWN,
    "/voltage": "std_msgs/msg/Float64",
}

Message = tuple[str, int, Any]


def angle(times: Any) -> Any:
    """Of the elbow; the wrist's is the negative."""
    return 0.5 * np.sin(5 * np.asarray(times))


def messages(unstamped: int = 0, count: int = COUNT) -> Iterator[Message]:
    """Topic, time of receipt [ns] and message, in order of time; the first ``unstamped`` instants have no stamps."""
    types, none = STORE.types, np.empty(0)
    vector, point = types["geometry_msgs/msg/Vector3"], types["trajectory_msgs/msg/JointTrajectoryPoint"]

    def header(stamp: int) -> Any:
        seconds, rest = divmod(stamp, 10**9)
        return types["std_msgs/msg/Header"](types["builtin_interfaces/msg/Time"](seconds, rest), "base")

    def at(positions: Any) -> Any:
        return point(positions, none, none, none, types["builtin_interfaces/msg/Duration"](0, 0))

    for k in range(count * 5):
        instant = START_NS + round(k * IMU_S * 1e9)
        t, received, stamp = k * IMU_S, instant + LATE_NS, instant if k >= unstamped else 0
        zero = vector(0.0, 0.0, 0.0)
        yield "/imu", received, types["sensor_msgs/msg/Imu"](
            header(stamp), types["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0), np.zeros(9), zero, np.zeros(9),
            vector(float(angle(t)), 0.0, 9.8), np.zeros(9),
        )  # fmt: skip
        if k % 5:
            continue
        both = np.array([angle(t), -angle(t)])
        yield (
            "/joint_states",
            received,
            types["sensor_msgs/msg/JointState"](header(stamp), JOINTS, both, none, 2 * both),
        )
        yield "/arm_controller/controller_state", received, types[STATE](
            header(stamp), JOINTS, at(both + 0.01), at(both), at(both), at(both), []
        )  # fmt: skip
        yield "/load", received, types[OWN](header(stamp), JOINTS, 3 * both, np.zeros(1000, dtype=np.uint8))
        yield "/voltage", received, types["std_msgs/msg/Float64"](12.0)


def write_rosbag(
    path: Path, storage: StoragePlugin, unstamped: int = 0, count: int = COUNT, is_compressed: bool = False
) -> None:
    """A folder as ``ros2 bag record`` makes it."""
    bag = BagWriter(path, version=9, storage_plugin=storage)
    if is_compressed:
        bag.set_compression(CompressionMode.MESSAGE, CompressionFormat.ZSTD)
    with bag as writer:
        connections = {topic: writer.add_connection(topic, kind, typestore=STORE) for topic, kind in TYPES.items()}
        for topic, received, message in messages(unstamped, count):
            writer.write(connections[topic], received, STORE.serialize_cdr(message, TYPES[topic]))


def write_mcap(path: Path, **options: Any) -> None:
    """The same as one file, in chunks of 16 kB."""
    with path.open("wb") as file:
        writer = McapWriter(file, chunk_size=16384, **options)
        writer.start("ros2")
        channels = {}
        for topic, kind in TYPES.items():
            text, _ = STORE.generate_msgdef(kind, ros_version=2)
            schema = writer.register_schema(kind, "ros2msg", text.encode())
            channels[topic] = writer.register_channel(topic, "cdr", schema)
        for topic, received, message in messages():
            data = bytes(STORE.serialize_cdr(message, TYPES[topic]))
            writer.add_message(channels[topic], received, data, received)
        writer.finish()


def write_unindexed(path: Path) -> None:
    """Without chunks and without an index, as simple recorders write it."""
    write_mcap(path, index_types=IndexType.NONE, use_chunking=False, use_statistics=False, use_summary_offsets=False)


def ros1(count: int = COUNT) -> Iterator[tuple[str, str, int, bytes]]:
    """Topic, type, time of receipt [ns] and bytes of messages of ROS 1: joint states, and a type of somebody's own."""
    joint_states, drive = "sensor_msgs/msg/JointState", "acme_msgs/msg/Drive"
    types = ROS1.types
    for k in range(count):
        t, instant = k * JOINT_S, START_NS + round(k * JOINT_S * 1e9)
        stamp = types["builtin_interfaces/msg/Time"](*divmod(instant, 10**9))
        header = types["std_msgs/msg/Header"](k, stamp, "base")
        both = np.array([angle(t), -angle(t)])
        state = types[joint_states](header, JOINTS, both, np.empty(0), 2 * both)
        own = types[drive](header, 3 * float(angle(t)))
        yield "/joint_states", joint_states, instant + LATE_NS, bytes(ROS1.serialize_ros1(state, joint_states))
        yield "/drive", drive, instant + LATE_NS, bytes(ROS1.serialize_ros1(own, drive))


def write_ros1(path: Path) -> None:
    """As ``rosbag record`` of ROS 1 makes it; two publishers of the joint states."""
    with Ros1Writer(path) as writer:
        kinds = dict.fromkeys((topic, kind) for topic, kind, _, _ in ros1())
        connections = {
            (topic, at): writer.add_connection(topic, kind, typestore=ROS1, callerid=f"/node{at}")
            for topic, kind in kinds
            for at in range(2)
        }
        for at, (topic, _, received, data) in enumerate(ros1()):
            writer.write(connections[topic, at // 50 % 2], received, data)


def write_ros1_mcap(path: Path) -> None:
    """The same messages in MCAP, whose types are called as ROS 1 does."""
    with path.open("wb") as file:
        writer = McapWriter(file)
        writer.start("ros1")
        channels = {}
        for topic, kind, received, data in ros1():
            if topic not in channels:
                text, _ = ROS1.generate_msgdef(kind, ros_version=1)
                schema = writer.register_schema(kind.replace("/msg/", "/"), "ros1msg", text.encode())
                channels[topic] = writer.register_channel(topic, "ros1", schema)
            writer.add_message(channels[topic], received, data, received)
        writer.finish()


def write_json(path: Path) -> None:
    """As Foxglove's SDK logs objects; and a topic of protobuf."""
    with path.open("wb") as file:
        writer = McapWriter(file)
        writer.start()
        schema = writer.register_schema("arm", "jsonschema", json.dumps({"type": "object"}).encode())
        channel = writer.register_channel("/arm", "json", schema)
        other = writer.register_channel("/tf", "protobuf", writer.register_schema("foxglove.Tf", "protobuf", b""))
        for k in range(COUNT):
            stamp = START_NS + k * 10_000_000
            value = {"timestamp": {"sec": stamp // 10**9, "nsec": stamp % 10**9}, "goal": {"position": k * 0.1},
                     "joints": [{"name": "elbow", "position": k * 0.2}], "ok": True, "note": "x"}  # fmt: skip
            writer.add_message(channel, stamp, json.dumps(value).encode(), stamp)
            writer.add_message(other, stamp, b"\x01", stamp)
        writer.finish()
