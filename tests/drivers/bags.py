"""Bags that rosbags and mcap write: two joints with a controller, an Imu, a type of somebody's own, and JSON."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from mcap.writer import IndexType
from mcap.writer import Writer as McapWriter
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as BagWriter
from rosbags.typesys import get_types_from_msg

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
