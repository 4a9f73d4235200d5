"""A listener to topics of ROS 2 over Zenoh: a client of the robot's router that declares subscribers and nothing else.

``ros2.py`` decodes the messages, ``codec/rmw_zenoh.py`` keys and tokens.  Zenoh is imported when a
session is opened.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Annotated, Any, Literal

import msgspec

from lostmotion.drivers.base import RobotOptions
from lostmotion.drivers.codec import rmw_zenoh
from lostmotion.drivers.codec.rmw_zenoh import Endpoint
from lostmotion.drivers.errors import PortError
from lostmotion.drivers.packages import missing

if TYPE_CHECKING:
    import zenoh

__all__ = ["Listener", "Message", "Ros2Network"]

WAITING = 4096
"""messages of a topic that may wait to be taken; then the oldest are lost"""
LOOK_S = 5e-4
"""how often a message that is about to come is looked for [s]"""
TOKENS_S = 1.0


class Ros2Network(RobotOptions, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """``[ros2]``: where the router of the robot is; its domain (ROS_DOMAIN_ID); the namespace of topics that are named
    without a leading slash; and ``bridge`` for a robot on DDS behind zenoh-bridge-ros2dds."""

    connect: Annotated[list[str], msgspec.Meta(min_length=1)] = msgspec.field(
        default_factory=lambda: ["tcp/127.0.0.1:7447"]
    )
    domain_id: Annotated[int, msgspec.Meta(ge=0, le=232)] = 0
    namespace: str = ""
    bridge: Literal["ros2dds"] | None = None


class Message(msgspec.Struct, frozen=True, gc=False):
    """One message: its type as package/msg/Type, its bytes, and what the publisher attached, b"" for nothing."""

    type: str
    data: bytes
    attached: bytes


class Listener:
    """Subscribes to some topics over one session of its own; opened again after the router went away."""

    def __init__(self, network: Ros2Network, topics: Mapping[str, str]) -> None:
        """topics: with the types that they have behind a bridge, whose keys do not have them."""
        self._network = network
        self.topics = tuple(topics)
        self._bridged = topics
        self.where = ", ".join(network.connect)
        self._session: zenoh.Session | None = None
        self._takes: dict[str, Callable[[], zenoh.Sample | None]] = {}
        self._types: dict[str, str] = {}

    def open(self) -> None:
        """Connects to the router.  Raises PortError."""
        self.close()
        try:
            import zenoh
        except ImportError as error:
            raise PortError(missing("zenoh", 'driver "ros2"') or str(error)) from error
        try:
            self._session = zenoh.open(_configuration(self._network))
            for topic in self.topics:
                handler: Any = zenoh.handlers.RingChannel(WAITING)
                self._takes[topic] = self._session.declare_subscriber(self._key(topic), handler).try_recv
        except zenoh.ZError as error:
            self.close()
            raise PortError(
                f"nobody answers at {self.where}; likely cause: no router runs there"
                " (ros2 run rmw_zenoh_cpp rmw_zenohd), or another address"
            ) from error

    def close(self) -> None:
        """Gives the session back."""
        session, self._session = self._session, None
        self._takes = {}
        if session is not None:
            session.close()  # type: ignore[no-untyped-call]

    def take(self, topic: str) -> list[Message]:
        """The messages of a topic that have come since the last call.  Raises PortError."""
        self._opened()
        take, messages = self._takes.get(topic), list[Message]()
        while take and (sample := _next(take)):
            attached = sample.attachment
            kind = self._bridged[topic] if self._network.bridge else self._type(str(sample.key_expr))
            messages.append(Message(kind, sample.payload.to_bytes(), attached.to_bytes() if attached else b""))
        return messages

    def wait(self, topic: str, seconds: float) -> list[Message]:
        """The same, but for the first to come from now on: then the time of its arrival is known."""
        end = time.monotonic() + seconds
        messages = self.take(topic)
        fresh: list[Message] = []
        while not fresh and time.monotonic() < end:
            time.sleep(LOOK_S)
            fresh = self.take(topic)
        return messages + fresh

    def check(self) -> None:
        """Raises PortError when the router went away, which Zenoh itself does not report."""
        info = self._opened().info
        if not (info.routers_zid() or info.peers_zid()):
            raise PortError(f"the router at {self.where} went away; likely cause: it ended, or the network is down")

    def publishers(self) -> list[Endpoint]:
        """All publishers of the domain, as their tokens show them.  Raises PortError."""
        key = rmw_zenoh.publisher_tokens_key(None if self._network.bridge else self._network.domain_id)
        replies = self._opened().liveliness().get(key, timeout=TOKENS_S)
        shown = [rmw_zenoh.endpoint(str(reply.ok.key_expr)) for reply in replies if reply.ok]
        return [one for one in shown if one]

    def _opened(self) -> zenoh.Session:
        if self._session is None:
            raise PortError(f"{self.where} is not open")
        return self._session

    def _key(self, topic: str) -> str:
        if self._network.bridge:
            return rmw_zenoh.bridged_key(topic)
        return rmw_zenoh.every_type_key(self._network.domain_id, topic)

    def _type(self, key: str) -> str:
        """The type in a key; one publisher has one key."""
        if key not in self._types:
            self._types = {key: rmw_zenoh.ros_type(key.split("/")[-2])}
        return self._types[key]


def _next(take: Callable[[], zenoh.Sample | None]) -> zenoh.Sample | None:
    """The next sample, None for none; also when another thread has closed the session."""
    from zenoh import ZError

    try:
        return take()
    except ZError:
        return None


def _configuration(network: Ros2Network) -> zenoh.Config:
    """A client that listens nowhere and does not scout."""
    import zenoh

    config = zenoh.Config()
    for key, value in {
        "mode": "client",
        "connect/endpoints": network.connect,
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
    }.items():
        config.insert_json5(key, json.dumps(value))
    return config
