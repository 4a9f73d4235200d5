"""A robot with ROS 2: a Zenoh router on loopback that publishes joint states, a controller's state and an Imu.

Keys, hashes and bytes are made with rosbags, from the messages' definitions, and not with the driver's own codecs.
"""

from __future__ import annotations

import json
import socket
import struct
import threading
import time
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from lostmotion.drivers.emulator.motion import Motion

if TYPE_CHECKING:
    import zenoh

__all__ = ["Ros2Robot", "free_port", "typestore"]

G_MS2 = 9.80665
LATE_S = 2.0
"""by which messages may be late and are sent all the same: a busy machine held them up, and their stamps have no gap;
with 0.2 s, of 200 messages a second 138 were left beside the six workers of all tests"""
ADVANCED = "sensor_msgs/msg/JointState"
POINT = "trajectory_msgs/JointTrajectoryPoint"
HEADER_AND_NAMES = "std_msgs/Header header\nstring[] joint_names\n"
LAYOUTS = {
    "old": HEADER_AND_NAMES + f"{POINT} desired\n{POINT} actual\n{POINT} error\n",
    "new": HEADER_AND_NAMES + f"{POINT} reference\n{POINT} feedback\n{POINT} error\n{POINT} output\n"
    "string[] multi_dof_joint_names\n",
}
"""control_msgs/msg/JointTrajectoryControllerState, before and after its fields were renamed"""
DYNAMIC = HEADER_AND_NAMES + "control_msgs/InterfaceValue[] interface_values\n"
INTERFACE = "string[] interface_names\nfloat64[] values\n"
STATE = "control_msgs/msg/JointTrajectoryControllerState"


def typestore(layout: Literal["old", "new"] = "new") -> Any:
    """rosbags' messages of Jazzy, with those of control_msgs."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS2_JAZZY)
    for name, text in {
        "InterfaceValue": INTERFACE,
        "DynamicJointState": DYNAMIC,
        "JointTrajectoryControllerState": LAYOUTS[layout],
    }.items():
        store.register(get_types_from_msg(text, f"control_msgs/msg/{name}"))
    return store


class Ros2Robot:
    """Publishes as rmw_zenoh does until the ``with`` block ends; ``unplug`` ends the router, ``plug`` starts it again.

    stamps: of the headers, the system's time times ``pace``, or 0; twice: a second publisher sends the same; silent:
    topics are announced, and nothing is sent; kind: of what is sent as joint states (another one: a wrong topic);
    bridge: keys and tokens as zenoh-bridge-ros2dds makes them.
    """

    def __init__(
        self,
        motion: Motion | None = None,
        joints: tuple[str, ...] = ("joint0", "joint1"),
        imu_hz: float = 1000.0,
        domain: int = 0,
        namespace: str = "",
        layout: Literal["old", "new"] = "new",
        joints_hz: float = 100.0,
        endpoint: str = "",
        bridge: bool = False,
    ) -> None:
        self.silent = self.twice = self.wrong = False
        self.stamps: Literal["system", "zero", "simulated"] = "system"
        self.pace, self.ahead_s = 1.0, 0.0
        self._motion = motion or Motion()
        self._names = list(joints)
        self._domain, self._namespace, self._bridge = domain, namespace.strip("/"), bridge
        self._store = typestore(layout)
        self._layout = layout
        self._hz = {"joint_states": joints_hz, "controller_state": joints_hz, "imu": imu_hz}
        self._endpoint = endpoint or f"tcp/127.0.0.1:{free_port()}"
        self._session: zenoh.Session | None = None
        self._lock = threading.Lock()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._serve, name="ros2-robot", daemon=True)
        self._sequence = 0
        self._begun = time.monotonic()
        self._tip = self._motion.tip(imu_hz) if imu_hz else np.empty(0)

    @property
    def paths(self) -> tuple[str, ...]:
        """Where its router listens."""
        return (self._endpoint,)

    def __enter__(self) -> Ros2Robot:
        self.plug()
        self._thread.start()
        return self

    def __exit__(self, *error: object) -> None:
        self._stop.set()
        self._thread.join()
        self.unplug()

    def plug(self, index: int = 0) -> None:
        """Starts the router, and shows node and publishers to ROS."""
        import zenoh

        config = zenoh.Config()
        config.insert_json5("mode", json.dumps("router"))
        config.insert_json5("listen/endpoints", json.dumps([self._endpoint]))
        config.insert_json5("scouting/multicast/enabled", "false")
        with self._lock:
            self._session = zenoh.open(config)
            zid = str(self._session.zid())
            shown = [self._token(zid, topic, number) for number, topic in enumerate(self._topics(), start=1)]
            self._tokens = [self._session.liveliness().declare_token(token) for token in shown]
            self._publishers = {topic: self._publisher(self._key(topic), topic) for topic in self._topics()}

    def unplug(self, index: int = 0) -> None:
        """Ends the router."""
        with self._lock:
            session, self._session = self._session, None
        if session is not None:
            session.close()  # type: ignore[no-untyped-call]

    def _topics(self) -> list[str]:
        return [topic for topic, rate in self._hz.items() if rate]

    def _type(self, topic: str) -> str:
        if self.wrong:
            return "std_msgs/msg/String"
        return {"joint_states": ADVANCED, "controller_state": STATE, "imu": "sensor_msgs/msg/Imu"}[topic]

    def _key(self, topic: str) -> str:
        full = "/".join(filter(None, (self._namespace, topic)))
        package, _, name = self._type(topic).split("/")
        hash = self._store.hash_rihs01(self._type(topic))
        return full if self._bridge else f"{self._domain}/{full}/{package}::msg::dds_::{name}_/{hash}"

    def _token(self, zid: str, topic: str, number: int) -> str:
        full = "/" + "/".join(filter(None, (self._namespace, topic)))
        if self._bridge:
            return f"@/{zid}/@ros2_lv/MP/{full[1:].replace('/', '§')}/{self._type(topic).replace('/', '§')}/:::,1"
        *_, kind, hash = self._key(topic).split("/")
        return (
            f"@ros2_lv/{self._domain}/{zid}/0/{number}/MP/%/%/robot/{full.replace('/', '%')}/{kind}/{hash}/::,1:,:,:,,"
        )

    def _publisher(self, key: str, topic: str) -> Any:
        """Joint states are transient local here: behind those stands Zenoh's advanced publisher with its cache."""
        from zenoh.ext import CacheConfig, declare_advanced_publisher

        assert self._session is not None
        if topic == "joint_states":
            return declare_advanced_publisher(self._session, key, cache=CacheConfig(1))
        return self._session.declare_publisher(key)

    def _serve(self) -> None:
        due = dict.fromkeys(self._topics(), time.monotonic())
        while not self._stop.is_set():
            topic = min(due, key=due.__getitem__)
            time.sleep(max(0.0, due[topic] - time.monotonic()))
            with self._lock:
                is_away = self._session is None
                if not (is_away or self.silent):
                    self._send(topic, due[topic])
            due[topic] += 1 / self._hz[topic]
            if due[topic] < time.monotonic() - (0.0 if is_away else LATE_S):
                due[topic] = time.monotonic()

    def _send(self, topic: str, moment: float) -> None:
        data = self._message(topic, moment)
        self._sequence += 1
        for gid in (b"a" * 16, b"b" * 16)[: 1 + self.twice]:
            attachment = struct.pack("<qqB", self._sequence, time.time_ns(), 16) + gid
            self._publishers[topic].put(data, **({} if self._bridge else {"attachment": attachment}))

    def _message(self, topic: str, moment: float) -> bytes:
        types = self._store.types
        if self.wrong:
            return bytes(self._store.serialize_cdr(types["std_msgs/msg/String"]("Hello"), "std_msgs/msg/String"))
        header = types["std_msgs/msg/Header"](self._stamp(moment), "base_link")
        if topic == "imu":
            return self._imu(header, moment)
        last = len(self._names) - 1
        at = [moment + 1.7 * (last - index) for index in range(len(self._names))]
        goals, angles, speeds = (
            np.array([of(time) for time in at])
            for of in (self._motion.goal, self._motion.position, self._motion.velocity)
        )
        if topic == "joint_states":
            message = types[ADVANCED](header, self._names, angles, speeds, np.zeros(len(at)))
            return bytes(self._store.serialize_cdr(message, ADVANCED))
        none = np.empty(0)
        rest = types["builtin_interfaces/msg/Duration"](0, 0)
        point = types["trajectory_msgs/msg/JointTrajectoryPoint"]
        points = [point(values, none, none, none, rest) for values in (goals, angles, goals - angles, goals)]
        more = (points[:3],) if self._layout == "old" else (points, [])
        message = types[STATE](header, self._names, *more[0], *more[1:])
        return bytes(self._store.serialize_cdr(message, STATE))

    def _imu(self, header: Any, moment: float) -> bytes:
        types = self._store.types
        vector = types["geometry_msgs/msg/Vector3"]
        tip = float(self._tip[int(moment * self._hz["imu"]) % self._tip.size])
        message = types["sensor_msgs/msg/Imu"](
            header, types["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0), np.zeros(9), vector(0.0, 0.0, 0.0),
            np.zeros(9), vector(tip, 0.0, G_MS2), np.zeros(9),
        )  # fmt: skip
        return bytes(self._store.serialize_cdr(message, "sensor_msgs/msg/Imu"))

    def _stamp(self, moment: float) -> Any:
        passed = (moment - self._begun) * self.pace + self.ahead_s
        seconds = 0.0 if self.stamps == "zero" else passed + 1.0 + (1.75e9 if self.stamps == "system" else 0.0)
        whole = int(seconds)
        return self._store.types["builtin_interfaces/msg/Time"](whole, int((seconds - whole) * 1e9))


def free_port() -> int:
    """A port of loopback that nobody has now."""
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return int(one.getsockname()[1])
