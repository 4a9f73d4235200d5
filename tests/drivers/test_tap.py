"""A second adapter on a line of another master: what real masters say is understood, and not a byte is sent."""

from __future__ import annotations

import math
import os
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from dynamixel_sdk import COMM_SUCCESS, GroupBulkWrite, GroupSyncRead, GroupSyncWrite, PacketHandler, PortHandler
from hypothesis import given, settings
from hypothesis import strategies as st

from lostmotion.drivers.base import ServoBus
from lostmotion.drivers.clock import SystemClock
from lostmotion.drivers.codec import feetech
from lostmotion.drivers.codec.dynamixel import Packet, encode
from lostmotion.drivers.codec.registers import Registers
from lostmotion.drivers.codec.servo_state import MODELS
from lostmotion.drivers.codec.sniffer import AccessKind, BusSniffer
from lostmotion.drivers.emulator import Emulator, FeetechLine, MasteredLine, Motion, ServoLine, Tap, TappedLine
from lostmotion.drivers.errors import DriverError, PortError
from lostmotion.drivers.tap import DRIVER
from tests.drivers.rigs import MOTION, readings, samples, servo_bus, servo_line, some, until

PACKETS = st.builds(
    Packet,
    st.sampled_from([1, 2, 0xFE]),
    st.sampled_from([0, 1, 2, 3, 4, 5, 0x55, 0x82, 0x83, 0x8A, 0x92, 0x93, 0x9A]),
    st.binary(max_size=40),
)
Line = tuple[str, ServoBus, Tap]


def tap_bus(port: str, joints: dict[int, str], **keys: Any) -> ServoBus:
    """The driver on a port; joints: models by ids; they are called by their ids."""
    tables = [
        {"name": str(id), "id": id, "model": model, "driver": "tap", "port": port, "accelerometer": "tip", **keys}
        for id, model in joints.items()
    ]
    assert DRIVER.servo is not None
    rows = [msgspec.convert(table, DRIVER.joint_options) for table in tables]
    return DRIVER.servo(rows, DRIVER.robot_options(), SystemClock())


@contextmanager
def tapped(line: ServoLine, joints: dict[int, str]) -> Iterator[Line]:
    """The port of a line's master, and a driver that listens there, open."""
    tap = Tap()
    with Emulator(TappedLine(line, tap), tap) as emulator:
        bus = tap_bus(emulator.paths[1], joints)
        bus.open()
        yield emulator.paths[0], bus, tap
        bus.close()


@contextmanager
def mastered(bus: ServoBus) -> Iterator[None]:
    """A driver of ours polls its servos meanwhile."""
    stop = threading.Event()

    def poll() -> None:
        while not stop.is_set():
            bus.read()

    bus.open()
    thread = threading.Thread(target=poll)
    thread.start()
    yield
    stop.set()
    thread.join()
    bus.close()


@pytest.mark.parametrize("model", ["AX-12A", "XL330-M288", "STS3215", "SCS0009"])
def test_what_a_polling_master_hears_is_heard(model: str) -> None:
    """Two servos polled at 100 Hz: both are known, with their goals; their angles are on the motion; velocity, volts
    and °C are told; nothing is sent."""
    with (
        tapped(servo_line(model, [1, 2]), {1: model, 2: model}) as (port, bus, tap),
        mastered(servo_bus(port, [1, 2], model)),
    ):
        found = bus.identify()
        heard = readings(bus, some(50, "1", "2"))
    assert all(one.ok and "goals received" in one.found for one in found)
    assert tap.received == b""
    step = (MODELS | feetech.MODELS)[model].step
    for name in ("1", "2"):
        own = samples(heard, name)
        ahead = 1.7 if name == "1" else 0.0
        # a sample is as old as the line and the machine let it be
        delays = np.arange(0.0, 0.15, 0.002)
        truth = [[MOTION.position(s.time - delay + ahead) for delay in delays] for s in own]
        assert np.median(np.min(np.abs(np.array(truth) - [[s.position] for s in own]), axis=1)) <= step
        assert {s.voltage for s in own} == {11.8}
        assert {s.temperature for s in own} == {41.0}
        assert not any(math.isnan(s.velocity) for s in own)


def sdk_port(path: str) -> PortHandler:
    """The port of ROBOTIS's SDK."""
    port = PortHandler(path)
    assert port.openPort()
    assert port.setBaudRate(1_000_000)
    return port


def goal_bytes(counts: int) -> list[int]:
    """A goal of protocol 2.0."""
    return list(counts.to_bytes(4, "little"))


def test_all_ways_of_the_makers_sdk_to_write_and_read() -> None:
    """ROBOTIS's own master: goals by write, sync write, bulk write and registered write with action, positions by read
    and sync read: all are heard, and nothing is sent."""
    line = ServoLine.of("XL330-M288", [1, 2], MOTION)
    with tapped(line, {1: "XL330-M288", 2: "XL330-M288"}) as (path, bus, tap):
        port, packets = sdk_port(path), PacketHandler(2.0)

        def goals() -> dict[str, int]:
            for id in (1, 2):  # an emulated servo may answer too late for the SDK on a busy machine: it is asked again
                assert any(packets.read4ByteTxRx(port, id, 132)[1] == COMM_SUCCESS for _ in range(20))
            time.sleep(0.02)
            heard = [sample for _ in range(3) for sample in bus.read().samples]
            step = MODELS["XL330-M288"].step
            return {sample.joint: round(sample.command / step) + 2048 for sample in heard}

        before = goals()
        assert set(before) == {"1", "2"}  # without a goal the command is the position
        packets.write4ByteTxRx(port, 1, 116, 1000)
        assert goals()["1"] == 1000
        sync = GroupSyncWrite(port, packets, 116, 4)
        for id in (1, 2):
            sync.addParam(id, goal_bytes(1000 + id))
        sync.txPacket()
        assert goals() == {"1": 1001, "2": 1002}
        bulk = GroupBulkWrite(port, packets)
        for id in (1, 2):
            bulk.addParam(id, 116, 4, goal_bytes(2000 + id))
        bulk.txPacket()
        assert goals() == {"1": 2001, "2": 2002}
        packets.regWriteTxRx(port, 1, 116, 4, goal_bytes(3001))
        assert goals()["1"] == 2001
        packets.action(port, 0xFE)
        assert goals()["1"] == 3001
        sync_read = GroupSyncRead(port, packets, 132, 4)
        sync_read.addParam(1)
        sync_read.addParam(2)
        until(lambda: sync_read.txRxPacket() == COMM_SUCCESS)
        readings(bus, some(1, "1", "2"))
        port.closePort()
    assert tap.received == b""


def test_the_kernel_lets_nothing_be_sent(tmp_path: Path) -> None:
    """The port is open for reading only, and for nobody else."""
    with Emulator(MasteredLine(ServoLine.of("AX-12A", [1], MOTION))) as emulator:
        bus = tap_bus(emulator.paths[0], {1: "AX-12A"})
        bus.open()
        links = [fd for fd in Path("/proc/self/fd").iterdir() if str(fd.resolve()) == emulator.paths[0]]
        (number,) = (fd for fd in links if _reads(fd))
        with pytest.raises(OSError, match="Bad file descriptor"):
            os.write(int(number.name), b"\xff")
        with pytest.raises(PortError, match="is busy"):
            tap_bus(emulator.paths[0], {1: "AX-12A"}).open()
        bus.close()


def _reads(fd: Path) -> bool:
    flags = next(line for line in (Path("/proc/self/fdinfo") / fd.name).read_text().splitlines() if "flags" in line)
    return int(flags.split()[1], 8) & os.O_ACCMODE == os.O_RDONLY


def test_both_protocols_on_one_line() -> None:
    """AX on protocol 1.0 and X on 2.0: each takes the other's frames for noise, and none is lost or counted broken."""
    one, other = ServoLine.of("AX-12A", [1], MOTION), ServoLine.of("XL330-M288", [2], MOTION)
    line = MasteredLine(ServoLine([*one.servos.values(), *other.servos.values()]))
    with Emulator(line) as emulator:
        bus = tap_bus(emulator.paths[0], {1: "AX-12A", 2: "XL330-M288"})
        bus.open()
        assert all(one.ok for one in bus.identify())
        found = readings(bus, some(30, "1", "2"))
        bus.close()
    assert sum(reading.broken for reading in found) == 0


def test_a_master_that_reads_other_registers_of_a_feetech_servo() -> None:
    """LeRobot reads two bytes of position and writes two of goal: the rest is unknown; a dead servo gives no sample."""
    line = FeetechLine.of("STS3215", [1, 2], Motion(play=0.0))
    line.servos[2].silent = True
    with tapped(line, {1: "STS3215", 2: "STS3215"}) as (path, bus, _):
        port, packets = sdk_port(path), PacketHandler(1.0)
        heard = []
        packets.write2ByteTxRx(port, 1, 42, 2100)
        for _ in range(5):
            for id in (1, 2):
                packets.readTx(port, id, 56, 2)
                time.sleep(0.03)
                port.is_using = False  # whatever came, the next one is asked
                port.clearPort()
            heard += bus.read().samples
        assert "2" in bus.read().silent
        port.closePort()
    assert {sample.joint for sample in heard} == {"1"}
    assert all(math.isnan(sample.voltage) for sample in heard)
    assert round(heard[-1].command / feetech.MODELS["STS3215"].step) + 2048 == 2100


@pytest.mark.parametrize(
    ("traffic", "words"),
    [
        (lambda line: Tap(), "nothing on the line; likely cause: its master does not run"),
        (lambda line: MasteredLine(ServoLine.of("AX-12A", [7], MOTION)), "no packets for it, but for other ids"),
        (lambda line: MasteredLine(ServoLine.of("XL330-M288", [1], MOTION)), "servos of another protocol"),
        (lambda line: MasteredLine(_dead()), "asked, and no answer received; likely cause: it has no power"),
    ],
)  # fmt: skip
def test_why_nothing_is_heard(traffic: Any, words: str) -> None:
    """A silent line, other ids, another protocol, a servo without power: each is told with its likely cause."""
    with Emulator(traffic(None)) as emulator:
        bus = tap_bus(emulator.paths[0], {1: "AX-12A"})
        bus.open()
        (who,) = bus.identify()
        assert bus.read().silent == ("1",)
        bus.close()
    assert not who.ok
    assert words in who.found


def _dead() -> ServoLine:
    line = ServoLine.of("AX-12A", [1], MOTION)
    line.servos[1].silent = True
    return line


@pytest.mark.parametrize("cut", [1, 7, 1000])
def test_a_fast_answer_for_all(cut: int) -> None:
    """Fast sync read: error, id, data and a checksum of each servo in one packet, the last checksum the packet's."""
    stream = BusSniffer(2)
    question = encode(Packet(0xFE, 0x8A, bytes((132, 0, 4, 0, 3, 7, 4))), 2)
    shares = [bytes((0, id)) + bytes((id, 1, 2, 3)) for id in (3, 7, 4)]
    answer = encode(Packet(0xFE, 0x55, b"\xaa\xbb".join(shares)), 2)
    line = b"\x00" + question + answer
    heard = [one for at in range(0, len(line), cut) for one in stream.feed(line[at : at + cut])]
    assert [one.id for one in heard if one.kind is AccessKind.ASKED] == [3, 7, 4]
    told = [(one.id, one.address, one.data) for one in heard if one.kind is AccessKind.ANSWERED]
    assert told == [(id, 132, bytes((id, 1, 2, 3))) for id in (3, 7, 4)]


def test_protocol_1_tells_answers_from_instructions() -> None:
    """An overheated servo's answer has the code of an instruction; a dead servo's next question is no answer; a read of
    several servos (bulk read) is answered by each."""
    stream = BusSniffer(1)

    def said(*packets: Packet) -> list[tuple[int, int, bytes]]:
        heard = [one for packet in packets for one in stream.feed(encode(packet, 1))]
        return [(one.id, one.address, one.data) for one in heard if one.kind is AccessKind.ANSWERED]

    read = Packet(1, 2, bytes((36, 2)))
    assert said(read, Packet(1, 0x04, b"\x10\x02")) == [(1, 36, b"\x10\x02")]
    assert said(read, read, Packet(1, 2, bytes((30, 2)))) == []
    assert said(Packet(1, 0, b"\x20\x02")) == [(1, 30, b"\x20\x02")]
    assert said(Packet(1, 0, b"\x20\x02")) == []  # nobody asked
    bulk = Packet(0xFE, 0x92, bytes((0, 2, 5, 36, 1, 6, 42)))
    assert said(bulk, Packet(5, 0, b"\x01\x02"), Packet(6, 0, b"\x78")) == [(5, 36, b"\x01\x02"), (6, 42, b"\x78")]


@settings(max_examples=int(os.environ.get("LOSTMOTION_EXAMPLES", "300")), deadline=None)
@given(st.sampled_from([1, 2]), st.lists(st.one_of(st.binary(max_size=60), PACKETS), max_size=12), st.integers(1, 50))
def test_any_traffic_is_taken(protocol: int, said: list[bytes | Packet], cut: int) -> None:
    """Whatever comes in: no error, registers of the sizes asked for, the same however it is cut."""
    line = b"".join(one if isinstance(one, bytes) else encode(one, protocol) for one in said)
    whole, pieces = BusSniffer(protocol), BusSniffer(protocol)
    heard = list(whole.feed(line))
    assert heard == [one for at in range(0, len(line), cut) for one in pieces.feed(line[at : at + cut])]
    registers = Registers(MODELS["XL330-M288" if protocol == 2 else "AX-12A"])
    for time_s, one in enumerate(heard):
        registers.update(one.address, one.data, time_s)
        assert math.isfinite(registers.state(time_s).position)


def test_an_unknown_model_is_refused() -> None:
    """The registers of a servo must be known, as a listener cannot ask which it is."""
    with pytest.raises(DriverError, match="no model 'AX-99' is known; there are AX-12A"):
        tap_bus("/dev/ttyUSB0", {1: "AX-99"})
