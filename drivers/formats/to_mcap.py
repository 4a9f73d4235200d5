"""A recording as MCAP with messages of ROS 2, which Foxglove, PlotJuggler and ``ros2 bag`` open.

/joint_states   sensor_msgs/msg/JointState: position, effort
/command        sensor_msgs/msg/JointState: the command
/imu            sensor_msgs/msg/Imu: the acceleration along x
/force, …       std_msgs/msg/Float64: every other column
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lostmotion.drivers.base import FloatArray
from lostmotion.drivers.codec.ros2_messages import IMU, JOINT_STATE
from lostmotion.drivers.errors import RecordingError
from lostmotion.drivers.formats.logs import OWN
from lostmotion.drivers.formats.needed import needed
from lostmotion.drivers.recording import Recording
from lostmotion.drivers.toml_text import toml_value

__all__ = ["write_mcap"]

NUMBER = "std_msgs/msg/Float64"
TOPICS = {"command": "/command", "position": "/joint_states", "torque": "/joint_states", "accel": "/imu"}
KINDS = {"/command": JOINT_STATE, "/joint_states": JOINT_STATE, "/imu": IMU}
WITHOUT_START_NS = 1_000_000_000
"""where a recording without a start begins: a stamp of 0 would be none"""
LATEST_S = 2**31 - 1.0
"""the largest stamp of ROS"""


def write_mcap(recording: Recording, joint: str, path: Path) -> int:
    """How many messages were written.  Raises RecordingError."""
    writer_module, typesys = (needed(name, "a file of MCAP") for name in ("mcap.writer", "rosbags.typesys"))
    store = typesys.get_typestore(typesys.Stores.ROS2_JAZZY)
    topics = {column: TOPICS.get(column, f"/{column}") for column in recording.columns}
    stamps = _stamps(recording)
    with path.open("wb") as file:
        writer = writer_module.Writer(file)
        writer.start("ros2", "lostmotion")
        writer.add_metadata(OWN, {key: toml_value(value) for key, value in recording.metadata.items()})
        channels = {topic: _channel(writer, store, topic) for topic in dict.fromkeys(topics.values())}
        count = 0
        for topic, row, message in _messages(recording, joint, topics, stamps, store.types):
            data = bytes(store.serialize_cdr(message, KINDS.get(topic, NUMBER)))
            writer.add_message(channels[topic], int(stamps[row]), data, int(stamps[row]))
            count += 1
        writer.finish()
    return count


def _channel(writer: Any, store: Any, topic: str) -> int:
    kind = KINDS.get(topic, NUMBER)
    text, _ = store.generate_msgdef(kind, ros_version=2)
    return int(writer.register_channel(topic, "cdr", writer.register_schema(kind, "ros2msg", text.encode())))


def _stamps(recording: Recording) -> NDArray[np.int64]:
    """When each row was measured [ns since 1970].  Raises RecordingError."""
    start = recording.start
    begin_ns = WITHOUT_START_NS if start is None else round(start.timestamp() * 1e6) * 1000
    if not 0 <= begin_ns * 1e-9 + recording.duration <= LATEST_S or begin_ns < 0:
        raise RecordingError(
            f"{recording.name}: found {recording.duration:g} s from {start or 'no start'} on, expected 1970 to 2038, "
            "the range of ROS's stamps"
        )
    since_first: NDArray[np.int64] = np.round((recording.time - recording.time[0]) * 1e9).astype(np.int64)
    return since_first + begin_ns


def _messages(
    recording: Recording, joint: str, topics: dict[str, str], stamps: Any, types: Any
) -> Iterator[tuple[str, int, Any]]:
    """Topic, row and message, row by row; what was not sampled in a row is not sent."""
    of: dict[str, list[str]] = {}
    for column, topic in topics.items():
        of.setdefault(topic, []).append(column)
    make = _Makers(joint, types)
    for row in range(len(recording.time)):
        for topic, columns in of.items():
            values = {name: recording.columns[name][row : row + 1] for name in columns}
            values = {name: value for name, value in values.items() if value[0] == value[0]}
            if values:
                yield topic, row, make.message(topic, int(stamps[row]), values)


class _Makers:
    """Makes rosbags' messages."""

    def __init__(self, joint: str, types: Any) -> None:
        self._names, self._types, self._none = [joint], types, np.empty(0)
        vector = types["geometry_msgs/msg/Vector3"]
        self._vector, self._still = vector, vector(0.0, 0.0, 0.0)
        self._upright = types["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0)
        self._unknown = np.array([-1.0, *[0.0] * 8])  # a covariance that means: not measured

    def message(self, topic: str, stamp_ns: int, values: dict[str, FloatArray]) -> Any:
        if topic not in KINDS:
            (value,) = values.values()
            return self._types[NUMBER](float(value[0]))
        seconds, rest = divmod(stamp_ns, 1_000_000_000)
        time = self._types["builtin_interfaces/msg/Time"](seconds, rest)
        header = self._types["std_msgs/msg/Header"](time, self._names[0])
        if topic == "/imu":
            acceleration = self._vector(float(values["accel"][0]), 0.0, 0.0)
            return self._types[IMU](
                header, self._upright, self._unknown, self._still, self._unknown, acceleration, np.zeros(9)
            )
        position = values.get("command" if topic == "/command" else "position", self._none)
        return self._types[JOINT_STATE](header, self._names, position, self._none, values.get("torque", self._none))
