"""A robot on a virtual CAN bus made of the canopen library's own nodes: drives, and the master that moves them."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import can
import canopen
import msgspec
from canopen.objectdictionary import (
    INTEGER16,
    INTEGER32,
    UNSIGNED8,
    UNSIGNED16,
    UNSIGNED32,
    ODRecord,
    ODVariable,
)

from lostmotion.drivers.base import OscillatorOptions
from lostmotion.drivers.clock import SystemClock
from lostmotion.drivers.registry import get_driver

OSCILLATOR = OscillatorOptions(f_res_hz=58.0)
COUNTS, RATIO = 4096, 100
STEP = math.tau / (COUNTS * RATIO)


def variable(name: str, index: int, subindex: int, kind: int, value: int) -> ODVariable:
    """An entry of an object dictionary that may be read, written and mapped."""
    entry = ODVariable(name, index, subindex)
    entry.data_type, entry.default, entry.access_type, entry.pdo_mappable = kind, value, "rw", True
    return entry


def dictionary() -> canopen.ObjectDictionary:
    """That of a small CiA 402 drive with two TPDOs and one RPDO, not mapped yet."""
    od = canopen.ObjectDictionary()
    od.node_id = None
    for name, index, kind, value in (
        ("Device type", 0x1000, UNSIGNED32, 402 | 2 << 16), ("Heartbeat", 0x1017, UNSIGNED16, 0),
        ("Controlword", 0x6040, UNSIGNED16, 0), ("Statusword", 0x6041, UNSIGNED16, 0x0637),
        ("Position demand", 0x6062, INTEGER32, 0), ("Position", 0x6064, INTEGER32, 0),
        ("Velocity", 0x606C, INTEGER32, 0), ("Rated current", 0x6075, UNSIGNED32, 2000),
        ("Rated torque", 0x6076, UNSIGNED32, 640), ("Torque", 0x6077, INTEGER16, 0),
        ("Current", 0x6078, INTEGER16, 0), ("DC link", 0x6079, UNSIGNED32, 48000), ("Target", 0x607A, INTEGER32, 0),
    ):  # fmt: skip
        od.add_object(variable(name, index, 0, kind, value))
    for name, index, values in (
        ("Identity", 0x1018, (0x9A, 0x77)), ("Resolution", 0x608F, (COUNTS, 1)), ("Gear", 0x6091, (RATIO, 1)),
    ):  # fmt: skip
        record = ODRecord(name, index)
        record.add_member(variable("count", index, 0, UNSIGNED8, 2))
        for sub, value in enumerate(values, 1):
            record.add_member(variable(f"sub{sub}", index, sub, UNSIGNED32, value))
        od.add_object(record)
    for communication, mapping in ((0x1400, 0x1600), (0x1800, 0x1A00), (0x1801, 0x1A01)):
        record = ODRecord(f"PDO {communication:X}", communication)
        record.add_member(variable("count", communication, 0, UNSIGNED8, 2))
        record.add_member(variable("COB-ID", communication, 1, UNSIGNED32, 0))
        record.add_member(variable("Type", communication, 2, UNSIGNED8, 1))
        od.add_object(record)
        array = ODRecord(f"Map {mapping:X}", mapping)
        array.add_member(variable("count", mapping, 0, UNSIGNED8, 0))
        for sub in range(1, 9):
            array.add_member(variable(f"entry {sub}", mapping, sub, UNSIGNED32, 0))
        od.add_object(array)
    return od


class LibraryDrive:
    """A drive that is the library's LocalNode: its PDO mapping, its frames, its SDO server are the library's."""

    def __init__(self, network: canopen.Network, node: int) -> None:
        self.node = network.create_node(node, dictionary())
        self._map(self.node.tpdo[1], 0x180 + node, (0x6041, 0x6064))
        self._map(self.node.tpdo[2], 0x280 + node, (0x606C, 0x6077, 0x6078))
        self._map(self.node.rpdo[1], 0x200 + node, (0x6040, 0x607A))

    def _map(self, pdo: Any, cob_id: int, objects: Sequence[int]) -> None:
        pdo.clear()
        for index in objects:
            pdo.add_variable(index)
        pdo.cob_id, pdo.enabled, pdo.trans_type = cob_id, True, 1
        pdo.save()

    def say(self, position: int, velocity: int = 0, torque: int = 0, current: int = 0, status: int = 0x0637) -> None:
        """Sends both TPDOs with these values."""
        first, second = self.node.tpdo[1], self.node.tpdo[2]
        first[0x6041].raw, first[0x6064].raw = status, position
        second[0x606C].raw, second[0x6077].raw, second[0x6078].raw = velocity, torque, current
        second.transmit()
        first.transmit()


class LibraryRobot:
    """Drives on a virtual bus, and a master on it as a third party: SYNC with a counter and the RPDOs."""

    def __init__(self, channel: str, nodes: Sequence[int]) -> None:
        self.network = canopen.Network()
        self.network.connect(interface="virtual", channel=channel)
        self.drives = {node: LibraryDrive(self.network, node) for node in nodes}
        self.master = can.Bus(channel, interface="virtual")
        self.count = 0
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None

    def send(self, id: int, data: bytes) -> None:
        """A frame of the master's."""
        self.master.send(can.Message(arbitration_id=id, data=data, is_extended_id=False))

    def cycle(self, time_s: float, status: int = 0x0637, skip: int = 0) -> None:
        """One SYNC, and what follows it; drive n moves as sin(t) x n milliradians, its target 10 counts ahead."""
        self.count = (self.count + skip) % 240 + 1
        self.send(0x80, bytes([self.count]))
        for node, drive in self.drives.items():
            position = round(1e-3 * node * math.sin(time_s) / STEP)
            self.send(0x200 + node, (0x000F).to_bytes(2, "little") + (position + 10).to_bytes(4, "little", signed=True))
            drive.say(position, velocity=100 * node, torque=250, current=-500, status=status)

    def start(self, period_s: float = 0.01) -> None:
        """Cycles from now on."""

        def run() -> None:
            begin = time.monotonic()
            due = begin
            while not self._stop.wait(max(0.0, due - time.monotonic())):
                self.cycle(due - begin)
                due += period_s

        self._stop.clear()
        self._thread = threading.Thread(target=run, daemon=True)
        self._thread.start()

    def halt(self) -> None:
        """No more cycles."""
        self._stop.set()
        if self._thread:
            self._thread.join()

    def beat(self, node: int, state: int) -> None:
        """A heartbeat of a node."""
        self.drives[node].node.network.send_message(0x700 + node, bytes([state]))

    def close(self) -> None:
        self.halt()
        self.master.shutdown()
        self.network.disconnect()


@contextmanager
def library_robot(channel: str, nodes: Sequence[int] = (1, 2)) -> Iterator[LibraryRobot]:
    """Such a robot until the block ends."""
    robot = LibraryRobot(channel, nodes)
    try:
        yield robot
    finally:
        robot.close()


def given(node: int) -> list[dict[str, Any]]:
    """The mapping of a LibraryDrive as a configuration gives it."""
    return [
        {"cob_id": 0x180 + node, "map": [0x60410010, 0x60640020]},
        {"cob_id": 0x280 + node, "map": [0x606C0020, 0x60770010, 0x60780010]},
        {"cob_id": 0x200 + node, "map": [0x60400010, 0x607A0020]},
    ]


def bus(channel: str, nodes: Sequence[int] = (1, 2), **keys: Any) -> Any:
    """The driver of these nodes on a virtual bus, by a given mapping unless ``sdo`` or ``eds`` says otherwise."""
    driver = get_driver("canopen")
    units = {} if keys.get("sdo") else {"counts_per_turn": COUNTS, "gear_ratio": RATIO}
    common = {"driver": "canopen", "port": channel, "interface": "virtual", "accelerometer": "tip", **units, **keys}
    mapped = keys.keys() & {"sdo", "eds", "pdo"}
    joints = [
        msgspec.convert(
            {"name": f"j{node}", "node": node, **common, **({} if mapped else {"pdo": given(node)})},
            driver.joint_options,
        )
        for node in nodes
    ]
    assert driver.servo is not None
    return driver.servo(joints, driver.robot_options(), SystemClock())


def sensor(name: str, channel: str, **keys: Any) -> Any:
    """An accelerometer on a virtual bus."""
    driver = get_driver(name)
    row = {"name": "tip", "driver": name, "port": channel, "interface": "virtual", "rate_hz": 1000.0, **keys}
    options = msgspec.convert({**row, "oscillator": {"f_res_hz": 58.0}}, driver.accelerometer_options)
    assert driver.accelerometer is not None
    return driver.accelerometer(options, driver.robot_options(), SystemClock())
