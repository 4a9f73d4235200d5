"""ROS 2's conventions on Zenoh: keys of topics, tokens, attachments, of rmw_zenoh and of zenoh-bridge-ros2dds.

No I/O.  rmw_zenoh's design page: a message on the topic /arm/joint_states in domain 0 has the key
``0/arm/joint_states/sensor_msgs::msg::dds_::JointState_/RIHS01_…`` (the type's hash of REP 2011); in a
token, which shows a publisher to the others, a slash of a name is a ``%``.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

__all__ = [
    "GID_BYTES",
    "Endpoint",
    "Sent",
    "attachment",
    "bridged_key",
    "data_key",
    "dds_type",
    "endpoint",
    "every_type_key",
    "publisher_tokens_key",
    "qualified",
    "ros_name",
    "ros_type",
    "sent",
    "tokens",
]

ADMIN = "@ros2_lv"
GID_BYTES = 16
QOS = "::,10:,:,:,,"
"""reliable, volatile, keep the last ten: what diagnostic_updater uses, as differences from rmw_zenoh's default"""
SENT = struct.Struct("<qqB16s")
PARTS = 13
"""of a publisher's token"""
BRIDGED_SLASH = "§"


@dataclass(frozen=True, slots=True)
class Endpoint:
    """A publisher as its token shows it: topic with its slash, type as package/msg/Type, node ("" if unknown)."""

    topic: str
    type: str
    node: str = ""


@dataclass(frozen=True, slots=True)
class Sent:
    """What rmw_zenoh attaches to a message: its number, when it was published [ns since 1970], and who did."""

    sequence: int
    time_ns: int
    gid: bytes


def qualified(topic: str, namespace: str) -> str:
    """A topic's full name: one without a leading slash stands in the namespace."""
    return topic if topic.startswith("/") else "/" + "/".join(filter(None, (namespace.strip("/"), topic)))


def dds_type(ros: str) -> str:
    """sensor_msgs/msg/Imu as it stands in keys: sensor_msgs::msg::dds_::Imu_."""
    package, kind, name = ros.split("/")
    return f"{package}::{kind}::dds_::{name}_"


def ros_type(dds: str) -> str:
    """The other way round; what has another form is left as it is."""
    parts = dds.split("::")
    return f"{parts[0]}/{parts[1]}/{parts[3].removesuffix('_')}" if len(parts) == 4 else dds


def data_key(domain: int, topic: str, ros: str, hash: str) -> str:
    """The key of a topic's messages."""
    return f"{domain}/{topic.strip('/')}/{dds_type(ros)}/{hash}"


def every_type_key(domain: int, topic: str) -> str:
    """Matches the messages of a topic, whatever their type: a hash differs from one distribution of ROS to the next."""
    return f"{domain}/{topic.strip('/')}/*/*"


def bridged_key(topic: str) -> str:
    """The key of a topic's messages behind zenoh-bridge-ros2dds: neither domain nor type."""
    return topic.strip("/")


def publisher_tokens_key(domain: int | None) -> str:
    """Matches the tokens of all publishers of a domain; of all behind a bridge where it is None."""
    return f"@/*/{ADMIN}/MP/**" if domain is None else f"{ADMIN}/{domain}/*/*/*/MP/**"


def endpoint(token: str) -> Endpoint | None:
    """The publisher that a token shows; None for another token, or one of another form."""
    parts = token.split("/")
    if parts[0] == ADMIN and len(parts) == PARTS and parts[5] == "MP":
        namespace, node, topic, kind = (part.replace("%", "/") for part in parts[7:11])
        return Endpoint(topic, ros_type(kind), f"{namespace.rstrip('/')}/{node}")
    if parts[0] == "@" and len(parts) >= 6 and parts[2:4] == [ADMIN, "MP"]:
        topic, kind = (part.replace(BRIDGED_SLASH, "/") for part in parts[4:6])
        return Endpoint(f"/{topic.strip('/')}", kind)
    return None


def tokens(domain: int, session: str, robot: str, node: str, topic: str, ros: str, hash: str) -> list[str]:
    """The liveliness tokens that show a node /<robot>/<node>, and its publisher, to ROS."""
    name = f"%/%{ros_name(robot)}/{node}"
    start = f"{ADMIN}/{domain}/{session}/0"
    return [f"{start}/0/NN/{name}", f"{start}/1/MP/{name}/%{topic}/{dds_type(ros)}/{hash}/{QOS}"]


def attachment(sequence: int, time_ns: int, gid: bytes) -> bytes:
    """What rmw_zenoh wants with each message: number, time [ns since 1970], and who sent it (16 bytes)."""
    return SENT.pack(sequence, time_ns, GID_BYTES, gid)


def sent(attached: bytes) -> Sent | None:
    """The content of an attachment; None for one of another form."""
    if len(attached) != SENT.size:
        return None
    sequence, time_ns, size, gid = SENT.unpack(attached)
    return Sent(sequence, time_ns, gid) if size == GID_BYTES else None


def ros_name(robot: str) -> str:
    """A robot's name as ROS allows it."""
    return "".join(letter if letter.isalnum() else "_" for letter in robot)
