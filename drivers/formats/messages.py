"""One message of a robot's log → its stamp and its numbers by name.  Bytes in, values out; no file is opened here.

Joint states, controllers' states and Imus of ROS 2 are decoded by our own codec, all other types of ROS 2, and those of
ROS 1, by rosbags from the definition that the file carries, JSON by itself.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from lostmotion.drivers.codec.cdr import CdrError
from lostmotion.drivers.codec.ros2_messages import (
    CONTROLLER_STATE,
    DECODERS,
    IMU,
    SECOND_NS,
    JointStates,
    imu_acceleration,
)
from lostmotion.drivers.formats.wpilog import ENCODING, decoder_of_entry
from lostmotion.drivers.packages import is_there

__all__ = ["BEFORE", "Decoded", "Decoder", "UnreadableError", "decoder_of", "flat"]

BEFORE = (*DECODERS, IMU)
"""types whose series come first where several fit a column, in this order"""
MOST_ENTRIES = 256
"""of a list that is signals; point clouds have more"""
MOST_BYTES = 1 << 20
"""of a message that is looked into; images have more"""
DEEPEST = 12
NAMES = ("name", "names", "joint_names")

Decoded = tuple[int | None, dict[str, float]]
"""the header's stamp [ns], None without one, and the numbers by name"""
Decoder = Callable[[bytes], Decoded]


class UnreadableError(ValueError):
    """The bytes are no message of their type."""


def decoder_of(kind: str, encoding: str, definition: str) -> Decoder | None:
    """What decodes messages of a type, None where nothing does.  definition: text of ros2msg or ros1msg, or empty."""
    if encoding == "json":
        return _json
    if encoding == ENCODING:
        return _entry(kind)
    if encoding == "cdr" and kind in DECODERS:
        return _joints(DECODERS[kind], kind == CONTROLLER_STATE)
    if encoding == "cdr" and kind == IMU:
        return _imu
    return _by_rosbags(kind, definition, encoding == "ros1") if encoding in ("cdr", "ros1") else None


def _entry(kind: str) -> Decoder | None:
    """Of a data log of WPILib."""
    decode = decoder_of_entry(kind)
    if decode is None:
        return None

    def decoder(data: bytes) -> Decoded:
        if len(data) > MOST_ENTRIES * 8:
            return None, {}
        try:
            return None, decode(data)
        except (ValueError, IndexError) as error:
            raise UnreadableError(f"no {kind}: {error}") from error

    return decoder


def _joints(decode: Callable[[bytes], JointStates], is_controller: bool) -> Decoder:
    position, effort = ("feedback.positions", "feedback.efforts") if is_controller else ("position", "effort")

    def decoder(data: bytes) -> Decoded:
        try:
            joints = decode(data)
        except CdrError as error:
            raise UnreadableError(str(error)) from error
        values = {}
        for field, numbers in (
            (position, joints.position), (effort, joints.effort), ("reference.positions", joints.reference)
        ):  # fmt: skip
            values.update({f"{field}[{name}]": number for name, number in zip(joints.names, numbers, strict=False)})
        return joints.stamp_ns or None, values

    return decoder


def _imu(data: bytes) -> Decoded:
    try:
        stamp, x, y, z = imu_acceleration(data)
    except CdrError as error:
        raise UnreadableError(str(error)) from error
    return stamp or None, {f"linear_acceleration.{axis}": value for axis, value in zip("xyz", (x, y, z), strict=True)}


def _json(data: bytes) -> Decoded:
    if len(data) > MOST_BYTES:
        return None, {}
    try:
        message = json.loads(data)
    except (ValueError, RecursionError) as error:
        raise UnreadableError(f"no JSON: {error}") from error
    return _stamp(message), dict(flat(message))


def _by_rosbags(kind: str, definition: str, is_ros1: bool) -> Decoder | None:
    """None where rosbags knows neither the type nor its definition, or is not installed."""
    if not is_there("rosbags"):
        return None
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC if is_ros1 else Stores.LATEST)
    deserialized = store.deserialize_ros1 if is_ros1 else store.deserialize_cdr
    if kind not in store.types:
        try:
            store.register({name: fields for name, fields in get_types_from_msg(definition, kind).items()
                            if name not in store.types})  # fmt: skip
        except Exception:  # noqa: BLE001 - whatever a parser raises on a definition it does not understand
            return None
        if kind not in store.types:
            return None

    def decoder(data: bytes) -> Decoded:
        if len(data) > MOST_BYTES:
            return None, {}
        try:
            message = deserialized(data, kind)
        except Exception as error:  # rosbags raises what struct and NumPy do
            raise UnreadableError(f"no {kind}: {error}") from error
        return _stamp(message), dict(flat(message))

    return decoder


def flat(value: Any, name: str = "", names: Sequence[str] = (), depth: int = 0) -> Iterator[tuple[str, float]]:
    """All numbers of a message by their path; lists that belong to names are indexed by these."""
    if isinstance(value, bool | str | bytes) or value is None or depth > DEEPEST:
        return
    if isinstance(value, int | float | np.number):
        yield name, float(value)
    elif (fields := _fields(value)) is not None:
        names = next((_texts(fields[key]) for key in NAMES if key in fields and _texts(fields[key])), names)
        for key, inner in fields.items():
            if key not in ("header", "stamp", "timestamp"):
                yield from flat(inner, f"{name}.{key}" if name else key, names, depth + 1)
    elif isinstance(value, list | tuple | np.ndarray) and 0 < len(value) <= MOST_ENTRIES:
        own = [_name(inner) for inner in value]
        for index, inner in enumerate(value):
            label = own[index] or (names[index] if len(names) == len(value) else str(index))
            yield from flat(inner, f"{name}[{label}]", (), depth + 1)


def _fields(value: Any) -> Mapping[str, Any] | None:
    if isinstance(value, Mapping):
        return {str(key): inner for key, inner in value.items()}
    if dataclasses.is_dataclass(value):
        return {each.name: getattr(value, each.name) for each in dataclasses.fields(value)}
    return None


def _texts(value: Any) -> Sequence[str]:
    return value if isinstance(value, list) and all(isinstance(each, str) for each in value) else ()


def _name(value: Any) -> str:
    """The name that an entry of a list gives itself."""
    fields = _fields(value) or {}
    return next((fields[key] for key in ("name", "joint_name") if isinstance(fields.get(key), str)), "")


def _stamp(message: Any) -> int | None:
    """The header's stamp [ns], as ROS and Foxglove write it; None for none, or 0."""
    fields = _fields(message) or {}
    header = _fields(fields.get("header")) or {}
    for stamp in (header.get("stamp"), fields.get("stamp"), fields.get("timestamp")):
        parts = _fields(stamp) or {}
        seconds, rest = parts.get("sec"), parts.get("nanosec", parts.get("nsec", 0))
        if isinstance(seconds, int) and isinstance(rest, int) and abs(seconds) < 1 << 33 and (seconds or rest):
            return seconds * SECOND_NS + rest
    return None
