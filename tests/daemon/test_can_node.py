"""The CANopen node that answers: SDO uploads, NMT, its EDS, asked by the canopen library as a master."""

from __future__ import annotations

import math
import struct
import threading
import time
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import can
import canopen
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lostmotion import __version__
from lostmotion.daemon.records import AlarmEvent, Health, JointRow
from lostmotion.daemon.sinks import can as sinking
from lostmotion.daemon.sinks.can import CanSink
from lostmotion.daemon.sinks.emcy import EmcyNode
from lostmotion.daemon.sinks.node import Node
from lostmotion.drivers.emulator import Emulator
from tests.daemon.canbus import JOINTS, SlcanAdapter
from tests.daemon.conftest import wait_until
from tests.daemon.test_can import FAULT, SCORE, WARNING, later, options

EDS = Path(sinking.__file__).with_name("lostmotion.eds")


@pytest.fixture
def network(request: pytest.FixtureRequest) -> Iterator[canopen.Network]:
    """A master on a virtual bus that is named after the test."""
    one = canopen.Network()
    one.connect(interface="virtual", channel=request.node.name)
    yield one
    one.disconnect()


def there(network: canopen.Network) -> canopen.RemoteNode:
    """The node, once its heartbeat says that it is on the bus."""
    remote = network.add_node(0x21, str(EDS))
    remote.sdo.RESPONSE_TIMEOUT = 5.0
    assert remote.nmt.wait_for_heartbeat(timeout=60) == "OPERATIONAL"
    return remote


def test_every_object_of_the_eds_is_answered(network: canopen.Network, request: pytest.FixtureRequest) -> None:
    """The library imports the file, asks for each object in it, and gets a value of its type; where the file gives a
    value, or a sum with the node, that one."""
    with closing(CanSink(JOINTS, options(request.node.name))) as sink:
        remote = there(network)
        sink.alarm(WARNING)
        for _ in range(7):
            sink.alarm(later(WARNING, AlarmEvent.CLEARED))
            sink.alarm(WARNING)
        wait_until(lambda: [entry.code for entry in remote.emcy.log].count(0xFF01) == 8)
        asked = 0
        for entry in remote.object_dictionary.values():
            for variable in entry.values() if hasattr(entry, "values") else [entry]:
                raw = remote.sdo.upload(variable.index, variable.subindex)
                asked += 1
                if variable.data_type in canopen.objectdictionary.NUMBER_TYPES:
                    assert len(raw) * 8 == len(variable), variable.qualname
                told = {0x1001: 0x81, 0x1003: 8, 0x1017: 100}.get(variable.index, variable.default)
                if told is not None and not (variable.index == 0x1003 and variable.subindex):
                    assert variable.decode_raw(raw) == told, variable.qualname
        assert asked == 1 + 1 + 9 + 3 + 2 + 5 + 3 + 3 + 5 + 5


def test_identity_history_and_state(network: canopen.Network, request: pytest.FixtureRequest) -> None:
    """Name and version in segments, the newest error first with its joint, the state that TPDO1 told; writing 0 deletes
    the history."""
    with closing(CanSink(JOINTS, options(request.node.name))) as sink:
        remote = there(network)
        assert remote.sdo[0x1008].raw == "lostmotion"
        assert remote.sdo[0x100A].raw == __version__
        assert (remote.sdo[0x1001].raw, remote.sdo[0x1003][0].raw) == (0, 0)
        sink.score(SCORE)
        sink.alarm(WARNING)
        sink.alarm(FAULT)
        sink.health(JointRow("elbow", Health.WARNING))
        wait_until(lambda: remote.sdo[0x1003][0].raw == 2)
        assert [remote.sdo[0x1003][sub].raw for sub in (1, 2)] == [0x0000FF03, 0x0001FF01]
        assert remote.sdo[0x1001].raw == 0x81
        wait_until(lambda: [remote.sdo[0x2000][sub].raw for sub in (1, 2, 4)] == [1, 2, 34])
        remote.sdo[0x1003][0].raw = 0
        assert remote.sdo[0x1003][0].raw == 0


@pytest.mark.parametrize(
    ("index", "subindex", "data", "code"),
    [
        (0x2001, 0, None, 0x06020000), (0x1018, 5, None, 0x06090011), (0x1003, 1, None, 0x06090011),
        (0x1017, 0, b"\0\0", 0x06010002), (0x1003, 0, b"\1", 0x06090030), (0x3000, 0, b"\0", 0x06020000),
    ],
)  # fmt: skip
def test_abort_codes(
    index: int, subindex: int, data: bytes | None, code: int, network: canopen.Network, request: pytest.FixtureRequest
) -> None:
    """What is not there, or must not be written, is refused by the code that CiA 301 has for it."""
    channel = request.node.name
    with closing(CanSink(JOINTS, options(channel))):
        remote = there(network)
        given = (index, subindex) if data is None else (index, subindex, data)
        ask = remote.sdo.upload if data is None else remote.sdo.download
        with pytest.raises(canopen.SdoAbortedError) as refused:
            ask(*given)  # type: ignore[operator]
    assert refused.value.code == code


def test_nmt_stops_starts_and_resets(network: canopen.Network, request: pytest.FixtureRequest) -> None:
    """Stopped: heartbeats and nothing else; started: all that stands; pre-operational: alarms and SDO, no states;
    reset: boot-up, and everything again."""
    beats: list[int] = []
    frames: list[int] = []
    network.subscribe(0x721, lambda number, data, stamp: beats.append(data[0]))
    for number in (0xA1, 0x1A1):
        network.subscribe(number, lambda number, data, stamp: frames.append(number))
    with closing(CanSink(JOINTS, options(request.node.name))) as sink:
        remote = there(network)
        wait_until(lambda: beats[-1:] == [5])
        remote.nmt.state = "STOPPED"
        wait_until(lambda: beats[-1:] == [4])
        frames.clear()
        sink.alarm(WARNING)
        sink.score(SCORE)
        remote.sdo.RESPONSE_TIMEOUT, remote.sdo.MAX_RETRIES = 0.3, 1
        with pytest.raises(canopen.SdoCommunicationError):
            remote.sdo.upload(0x1000, 0)
        remote.sdo.RESPONSE_TIMEOUT = 5.0
        assert frames == []
        remote.nmt.state = "PRE-OPERATIONAL"
        wait_until(lambda: beats[-1:] == [0x7F])
        assert frames == [0xA1, 0xA1]
        assert remote.sdo.upload(0x1001, 0) == b"\x81"
        remote.nmt.state = "OPERATIONAL"
        wait_until(lambda: frames[-1:] == [0x1A1])
        frames.clear()
        beats.clear()
        remote.nmt.state = "RESET"
        wait_until(lambda: 0 in beats and beats[-1] == 5)
        wait_until(lambda: frames == [0xA1, 0xA1, 0x1A1])


class Asking(SlcanAdapter):
    """An adapter whose bus also says something; say: as the adapter writes it."""

    def __init__(self) -> None:
        super().__init__()
        self.say = b""

    def due(self) -> float:
        return -math.inf if self.say else math.inf

    def emit(self, now: float) -> bytes:
        said, self.say = self.say, b""
        return said


def test_a_node_that_nobody_asks_sleeps() -> None:
    """On a serial adapter it wakes for its heartbeat, ten times a second here, and for a question at once; no more."""
    adapter = Asking()
    with (
        Emulator(adapter) as emulator,
        closing(CanSink(JOINTS, options(emulator.paths[0], "slcan", sleep_after_open=0))) as sink,
    ):
        wait_until(lambda: (0x721, b"\5") in adapter.frames)
        thread = Path(f"/proc/self/task/{sink._thread.native_id}/status")

        def waits() -> int:
            return int(thread.read_text().split("\nvoluntary_ctxt_switches:")[1].split()[0])

        before, start = waits(), time.monotonic()
        time.sleep(2.0)
        # a beat is one wait, and one for the adapter's driver to take it
        assert waits() - before <= 3.5 * 10 * (time.monotonic() - start)
        adapter.say = b"t62184018100000000000\r"
        wait_until(lambda: (0x5A1, b"\x4f\x18\x10\0\x04\0\0\0") in adapter.frames)


def test_a_flood_of_questions_delays_no_alarm(network: canopen.Network, request: pytest.FixtureRequest) -> None:
    """While a bus asks faster than anybody can answer, an alarm goes out."""
    done = threading.Event()

    def ask() -> None:
        with can.Bus(request.node.name, interface="virtual") as bus:
            while not done.is_set():
                bus.send(can.Message(arbitration_id=0x621, data=bytes(8), is_extended_id=False))

    with closing(CanSink(JOINTS, options(request.node.name))) as sink:
        remote = there(network)
        asking = threading.Thread(target=ask)
        asking.start()
        try:
            time.sleep(0.2)
            sink.alarm(WARNING)
            wait_until(lambda: remote.emcy.log and remote.emcy.log[-1].code == 0xFF01)
        finally:
            done.set()
            asking.join()


@settings(max_examples=300, deadline=None)
@given(frames=st.lists(st.tuples(st.sampled_from((0, 0x621, 0x622)), st.binary(max_size=8)), max_size=30))
def test_any_frames_at_all_to_the_node(frames: list[tuple[int, bytes]]) -> None:
    """No exception; the node is in a state that CiA 301 has, and answers when it was started."""
    node = Node(EmcyNode(0x21, JOINTS), 0x21, 1.0)
    for cob_id, data in frames:
        for frame in node.receive(cob_id, data)[0]:
            assert len(frame.data) <= 8
    assert node.state in (4, 5, 0x7F)
    node.receive(0, b"\1\0")
    [answer], _ = node.receive(0x621, struct.pack("<BHB4x", 0x40, 0x1000, 0))
    assert answer.data == struct.pack("<BHBI", 0x43, 0x1000, 0, 0)


def test_commands_to_other_nodes_are_not_obeyed() -> None:
    """Stop for node 0x22 leaves node 0x21 as it is; stop for all stops it."""
    node = Node(EmcyNode(0x21, JOINTS), 0x21, 1.0)
    node.receive(0, b"\2\x22")
    assert node.state == 5
    node.receive(0, b"\2\0")
    assert node.state == 4
