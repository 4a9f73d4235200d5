"""The messages of ROS 2 with joints and accelerations, from their bytes.  No I/O.

JointTrajectoryControllerState has had three layouts.  In all of them two points follow the joints' names: what the
controller wants (``desired``, now ``reference``) and what it sees (``actual``, now ``feedback``); the rest is not read.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from types import MappingProxyType

import msgspec

from lostmotion.drivers.codec.cdr import CdrError, CdrReader

__all__ = ["CONTROLLER_STATE", "DECODERS", "IMU", "JOINT_STATE", "JointStates", "imu_acceleration"]

IMU = "sensor_msgs/msg/Imu"
JOINT_STATE = "sensor_msgs/msg/JointState"
CONTROLLER_STATE = "control_msgs/msg/JointTrajectoryControllerState"
SECOND_NS = 1_000_000_000


class JointStates(msgspec.Struct, frozen=True, gc=False):
    """One message: its header's stamp [ns] and, of each joint, position [rad], velocity [rad/s], effort [N m] and what
    the controller wants [rad]; empty where it has none."""

    stamp_ns: int
    names: tuple[str, ...]
    position: tuple[float, ...]
    velocity: tuple[float, ...] = ()
    effort: tuple[float, ...] = ()
    reference: tuple[float, ...] = ()


def joint_state(data: bytes) -> JointStates:
    """sensor_msgs/msg/JointState.  Raises CdrError."""
    reader = CdrReader(data)
    stamp = _header(reader)
    names = reader.texts()
    values = [_fitting(reader.doubles(), names) for _ in range(3)]
    return JointStates(stamp, names, *values)


def controller_state(data: bytes) -> JointStates:
    """control_msgs/msg/JointTrajectoryControllerState, whichever layout.  Raises CdrError."""
    reader = CdrReader(data)
    stamp = _header(reader)
    names = reader.texts()
    wanted, _, _ = (_fitting(each, names) for each in _point(reader))
    position, velocity, effort = (_fitting(each, names) for each in _point(reader))
    return JointStates(stamp, names, position, velocity, effort, wanted)


def dynamic_joint_state(data: bytes) -> JointStates:
    """control_msgs/msg/DynamicJointState: its interfaces position, velocity and effort.  Raises CdrError."""
    reader = CdrReader(data)
    stamp = _header(reader)
    names = reader.texts()
    (count,) = reader.numbers("I")
    if count != len(names):
        raise CdrError(f"found values of {count} joints, expected those of {len(names)}")
    interface_values = []
    for _ in names:
        interfaces = reader.texts()
        interface_values.append(dict(zip(interfaces, _fitting(reader.doubles(), interfaces), strict=False)))
    position, velocity, effort = (
        tuple(one.get(kind, math.nan) for one in interface_values) for kind in ("position", "velocity", "effort")
    )
    return JointStates(stamp, names, position, velocity, effort)


def imu_acceleration(data: bytes) -> tuple[int, float, float, float]:
    """sensor_msgs/msg/Imu: the stamp [ns] and the linear acceleration [m/s²] along x, y and z.  Raises CdrError."""
    reader = CdrReader(data)
    stamp = _header(reader)
    x, y, z, *_ = reader.numbers("37d")[25:]  # behind orientation, turning, and the covariances of both
    return stamp, x, y, z


DECODERS: Mapping[str, Callable[[bytes], JointStates]] = MappingProxyType(
    {
        JOINT_STATE: joint_state,
        CONTROLLER_STATE: controller_state,
        "control_msgs/msg/DynamicJointState": dynamic_joint_state,
    }
)


def _header(reader: CdrReader) -> int:
    """A std_msgs/Header: its stamp [ns]."""
    (seconds,) = reader.numbers("i")
    (fraction,) = reader.numbers("I")
    reader.skip_text()
    return int(seconds) * SECOND_NS + int(fraction)


def _point(reader: CdrReader) -> tuple[tuple[float, ...], tuple[float, ...], tuple[float, ...]]:
    """A trajectory_msgs/JointTrajectoryPoint: positions, velocities, efforts."""
    positions, velocities, _, efforts = (reader.doubles() for _ in range(4))
    reader.numbers("2I")
    return positions, velocities, efforts


def _fitting(values: tuple[float, ...], names: tuple[str, ...]) -> tuple[float, ...]:
    """The values, of which there is one for each joint, or none."""
    if values and len(values) != len(names):
        raise CdrError(f"found {len(values)} values, expected {len(names)}, one for each name")
    return values
