"""Alarms on CAN: the frames to the letter, other libraries' opinion of them, and a bus that fails in many ways."""

from __future__ import annotations

import errno
import json
import logging
import math
import os
import signal
import struct
import time
import tty
from collections.abc import Callable, Iterator
from contextlib import closing
from datetime import UTC, datetime, timedelta
from pathlib import Path
from types import SimpleNamespace

import can
import canopen
import cantools
import msgspec
import pytest
from can import interfaces

from lostmotion.daemon.lifecycle import happen, raised
from lostmotion.daemon.options import CanOptions
from lostmotion.daemon.records import AlarmEvent, Cause, Health, JointRow, ScoreRow, Severity, Transition
from lostmotion.daemon.sinks import can as sinking
from lostmotion.daemon.sinks.can import CanSink
from lostmotion.daemon.sinks.emcy import EmcyNode
from lostmotion.daemon.sinks.wakeup import Wakeup
from lostmotion.drivers.emulator import Emulator
from tests.daemon.canbus import JOINTS, FaultyBus, SlcanAdapter, SocketcandServer, frame_of
from tests.daemon.cli_world import SIMULATED, call
from tests.daemon.conftest import Running, wait_until
from tests.daemon.fakes import fake_config

NOON = datetime(2026, 1, 31, 12, tzinfo=UTC)
SCORE = ScoreRow("elbow", NOON, 0.25, 17.54, 8.0, True, play=math.radians(3.4 / 60))
WARNING = raised("elbow", Cause.PLAY, Severity.WARNING, "much", NOON)
FAULT = raised("shoulder", Cause.DEVICE, Severity.ERROR, "no data", NOON)
DBC = Path(sinking.__file__).with_name("lostmotion.dbc")


def later(change: Transition, event: AlarmEvent, severity: Severity | None = None) -> Transition:
    """What happens next to the same alarm."""
    return happen(change.alarm, event, change.time + timedelta(seconds=1), severity=severity, until=NOON)


def options(channel: str, interface: str = "virtual", **more: str | int | float | bool) -> CanOptions:
    """Node 0x21 on a bus, with a heartbeat ten times a second."""
    return CanOptions(interface=interface, channel=channel, node_id=0x21, heartbeat_s=0.1, options=more)


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """A bus that has failed is tried again soon."""
    monkeypatch.setattr(sinking, "FIRST_RETRY_S", 0.05)
    monkeypatch.setattr(sinking, "SEND_S", 0.1)


@pytest.fixture
def monitor(request: pytest.FixtureRequest) -> Iterator[can.BusABC]:
    """The other end of a virtual bus that is named after the test."""
    with can.Bus(request.node.name, interface="virtual") as bus:
        yield bus


def codes(node: EmcyNode, change: Transition) -> list[str]:
    """The bytes of the frames that a transition calls for."""
    return [frame.data.hex(" ") for frame in node.alarm(change)]


def test_the_frames_to_the_letter() -> None:
    """Code, register, joint, score x 10 and play x 10, little-endian; 0xFFFF where nothing is known; the COB-IDs."""
    node = EmcyNode(0x21, JOINTS)
    node.score(SCORE)
    (frame,) = node.alarm(WARNING)
    assert (frame.cob_id, frame.data.hex(" ")) == (0xA1, "01 ff 81 01 af 00 22 00")
    escalated = codes(node, later(WARNING, AlarmEvent.ESCALATED, Severity.ERROR))
    assert escalated == ["00 00 81 01 af 00 22 00", "02 ff 81 01 af 00 22 00"]
    assert codes(node, FAULT) == ["03 ff 81 00 ff ff ff ff"]
    beat = node.heartbeat()
    assert (beat.cob_id, beat.data) == (0x721, b"\x05")
    node.score(ScoreRow("elbow", NOON, 0.25, 7000.0, 8.0, True, play=math.inf))
    assert node.everything()[1].data.hex(" ") == "02 ff 81 01 fe ff ff ff"


def test_the_state_to_the_letter() -> None:
    """TPDO1: joint, health, severity x 10, play x 10, little-endian; 0xFFFF where nothing is known; cantools reads it
    by the DBC file."""
    node = EmcyNode(0x21, JOINTS)
    assert node.states() == node.state("stranger") == []
    node.score(msgspec.structs.replace(SCORE, severity=math.radians(36.1 / 60)))
    node.health("elbow", Health.WARNING)
    node.health("shoulder", Health.OK)
    assert node.states() == ["shoulder", "elbow"]
    (frame,), (other,) = node.state("elbow"), node.state("shoulder")
    assert (frame.cob_id, frame.data.hex(" ")) == (0x1A1, "01 02 69 01 22 00")
    assert other.data.hex(" ") == "00 00 ff ff ff ff"
    database = cantools.database.load_file(DBC, strict=True)
    assert database.decode_message(frame.cob_id, frame.data) == {
        "StateJointIndex": 1, "Health": "WARNING", "Severity": pytest.approx(36.1), "StatePlay": pytest.approx(3.4),
    }  # fmt: skip


def test_canopen_receives_the_states(request: pytest.FixtureRequest) -> None:
    """The canopen library's TPDO1 of the node tells the newest state; a thousand scores at once are no flood, and
    alarms go before them."""
    network = canopen.Network()
    network.connect(interface="virtual", channel=request.node.name)
    found: list[bytes] = []
    network.subscribe(0x1A1, lambda number, data, stamp: found.append(bytes(data)))
    with closing(CanSink(JOINTS, options(request.node.name))) as sink:
        for k in range(1000):
            sink.score(msgspec.structs.replace(SCORE, severity=1e-5 * k))
        sink.health(JointRow("elbow", Health.ERROR))
        last = struct.pack("<BBHH", 1, 3, round(math.degrees(9.99e-3) * 600), 34)
        wait_until(lambda: found and found[-1] == last)
        assert len(found) < 1000
    network.disconnect()


def test_states_rest_and_alarms_do_not(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """After a state the next ones wait until the rest is over, and then only the newest is sent; an alarm amid the rest
    is told at once.  By a clock that the test sets."""
    now = 100.0
    monkeypatch.setattr(sinking, "time", SimpleNamespace(monotonic=lambda: now))
    with (
        can.Bus(request.node.name, interface="virtual") as bus,
        closing(CanSink(JOINTS, options(request.node.name))) as sink,
    ):
        sink.score(SCORE)
        frame_of(bus, 0x1A1)
        for k in range(100):
            sink.score(msgspec.structs.replace(SCORE, severity=1e-5 * k))
        sink.alarm(WARNING)
        assert identifiers_until(bus, 0xA1).count(0x1A1) == 0
        now += 0.9 * sinking.REST_S
        sink.alarm(FAULT)
        assert identifiers_until(bus, 0xA1).count(0x1A1) == 0
        now += 0.2 * sinking.REST_S
        assert frame_of(bus, 0x1A1).data == struct.pack("<BBHH", 1, 0, round(math.degrees(9.9e-4) * 600), 34)
        sink.alarm(later(FAULT, AlarmEvent.CLEARED))
        assert identifiers_until(bus, 0xA1).count(0x1A1) == 0


def identifiers_until(bus: can.BusABC, last: int) -> list[int]:
    """The identifiers of the frames before the next one with that identifier."""
    found: list[int] = []
    while (message := bus.recv(60.0)) is not None and message.arbitration_id != last:
        found.append(message.arbitration_id)
    assert message is not None, f"no frame 0x{last:X}"
    return found


def test_a_cleared_error_leaves_the_others_standing() -> None:
    """Error reset with a register that still shows an error, then the others again; the last clears the register."""
    node = EmcyNode(0x21, JOINTS)
    node.alarm(WARNING)
    node.alarm(FAULT)
    cleared = codes(node, later(WARNING, AlarmEvent.CLEARED))
    assert cleared == ["00 00 81 01 ff ff ff ff", "03 ff 81 00 ff ff ff ff"]
    assert codes(node, later(FAULT, AlarmEvent.SHELVED)) == ["00 00 00 00 ff ff ff ff"]
    assert [frame.data.hex() for frame in node.everything()] == ["000000ffffffffff"]


def test_an_error_that_eases_is_forgotten_by_a_master() -> None:
    """A consumer that keeps every code until a reset holds what stands and nothing else, after each transition."""
    node, kept = EmcyNode(0x21, JOINTS), set[tuple[int, int]]()

    def hear(change: Transition) -> set[tuple[int, int]]:
        for frame in node.alarm(change):
            code, joint = int.from_bytes(frame.data[:2], "little"), frame.data[3]
            kept.clear() if code == 0 else kept.add((code, joint))
        return kept

    assert hear(WARNING) == {(0xFF01, 1)}
    assert hear(FAULT) == {(0xFF01, 1), (0xFF03, 0)}
    assert hear(later(WARNING, AlarmEvent.ESCALATED, Severity.ERROR)) == {(0xFF02, 1), (0xFF03, 0)}
    assert hear(later(WARNING, AlarmEvent.EASED, Severity.WARNING)) == {(0xFF01, 1), (0xFF03, 0)}
    assert hear(later(WARNING, AlarmEvent.EASED, Severity.DEGRADED)) == {(0xFF03, 0)}
    assert hear(later(FAULT, AlarmEvent.CLEARED)) == set()


def test_what_changes_nothing_on_the_bus_is_not_sent() -> None:
    """Acknowledging and a mere DEGRADED send nothing; a reminder sends the error again."""
    node = EmcyNode(0x21, JOINTS)
    assert codes(node, raised("elbow", Cause.PLAY, Severity.DEGRADED, "some", NOON)) == []
    node.alarm(WARNING)
    assert codes(node, later(WARNING, AlarmEvent.ACKNOWLEDGED)) == []
    assert len(codes(node, later(WARNING, AlarmEvent.REMINDED))) == 1
    assert codes(node, raised("stranger", Cause.PLAY, Severity.ERROR, "much", NOON)) == []


def test_the_dbc_file_describes_the_frames() -> None:
    """cantools loads the file without complaint and reads from our bytes what we put in."""
    database = cantools.database.load_file(DBC, strict=True)
    node = EmcyNode(0x21, JOINTS)
    node.score(SCORE)
    (frame,) = node.alarm(WARNING)
    assert database.decode_message(frame.cob_id, frame.data) == {
        "ErrorCode": "play warning", "ErrorRegister": 0x81, "JointIndex": 1,
        "Score": pytest.approx(17.5), "Play": pytest.approx(3.4),
    }  # fmt: skip
    beat = node.heartbeat()
    assert database.decode_message(beat.cob_id, beat.data) == {"NmtState": "operational"}
    reset = node.everything()[0]
    assert database.decode_message(reset.cob_id, reset.data)["ErrorCode"] == "cleared"


def test_canopen_understands_them(request: pytest.FixtureRequest) -> None:
    """The canopen library's consumer keeps the active errors, and its heartbeat consumer the state of the node."""
    network = canopen.Network()
    network.connect(interface="virtual", channel=request.node.name)
    remote = network.add_node(0x21, canopen.ObjectDictionary())
    with closing(CanSink(JOINTS, options(request.node.name))) as sink:
        wait_until(lambda: remote.emcy.log)
        sink.score(SCORE)
        for change in (WARNING, FAULT, later(WARNING, AlarmEvent.CLEARED)):
            sink.alarm(change)
        wait_until(lambda: [entry.code for entry in remote.emcy.active] == [0xFF03])
        assert [entry.code for entry in remote.emcy.log][-4:] == [0xFF01, 0xFF03, 0x0000, 0xFF03]
        assert remote.emcy.log[-4].data == bytes.fromhex("01 af 00 22 00")
        assert remote.nmt.wait_for_heartbeat(timeout=60) == "OPERATIONAL"
    network.disconnect()


def test_a_restarted_service_tells_what_stands(monitor: can.BusABC, request: pytest.FixtureRequest) -> None:
    """Boot-up, error reset, and the errors that an earlier run has raised, in that order."""
    with closing(CanSink(JOINTS, options(request.node.name))) as sink:
        sink.alarm(FAULT, again=True)
        assert frame_of(monitor, 0x721).data == b"\x00"
        assert frame_of(monitor, 0xA1).data[:2] == b"\x00\x00"
        assert frame_of(monitor, 0xA1).data[:2] == b"\x03\xff"


@pytest.mark.parametrize("code", [errno.ENOBUFS, errno.ENETDOWN])
def test_a_full_queue_and_bus_off_are_survived(
    code: int, request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """While no frame can be sent the caller never waits; afterwards what stands is told, what went away is not."""
    monkeypatch.setitem(interfaces.BACKENDS, "virtual", ("tests.daemon.canbus", "FaultyBus"))
    with (
        can.Bus(request.node.name, interface="virtual") as monitor,
        closing(CanSink(JOINTS, options(request.node.name))) as sink,
    ):
        frame_of(monitor, 0x721)
        monkeypatch.setattr(FaultyBus, "error_code", code)
        begin = time.monotonic()
        for _ in range(1000):
            sink.alarm(WARNING)
            sink.alarm(later(WARNING, AlarmEvent.CLEARED))
        sink.alarm(FAULT)
        assert time.monotonic() - begin < 5.0
        wait_until(lambda: "trying again" in caplog.text)
        while monitor.recv(0.0):
            pass
        monkeypatch.setattr(FaultyBus, "error_code", None)
        assert [frame_of(monitor, 0xA1).data[:2].hex() for _ in range(2)] == ["0000", "03ff"]
    assert caplog.text.count("trying again") == 1


@pytest.mark.parametrize("echoes", [False, True])
def test_a_second_device_of_the_same_number_is_told_once(
    echoes: bool, monitor: can.BusABC, request: pytest.FixtureRequest, caplog: pytest.LogCaptureFixture
) -> None:
    """Two nodes of one number: a master would mix up their errors.  Our own heartbeats, of a bus that is asked to give
    them back, are none of another device, and neither is the heartbeat of another number."""
    channel = request.node.name
    with closing(CanSink(JOINTS, options(channel, **({"receive_own_messages": True} if echoes else {})))):
        frame_of(monitor, 0x721)
        for number in (0x722, *(() if echoes else (0x721,) * 3)):
            monitor.send(can.Message(arbitration_id=number, data=[5], is_extended_id=False))
        monitor.send(can.Message(arbitration_id=0x621, data=bytes.fromhex("4000100000000000"), is_extended_id=False))
        frame_of(monitor, 0x5A1)
    told = f"CAN virtual {channel}: another device sends heartbeats as node 0x21; give one of them another number"
    assert caplog.text.count(told) == (0 if echoes else 1)


def test_a_bus_that_comes_and_goes_is_told_once(
    request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """Nobody acknowledges: it opens, takes frames until its queue is full, and begins anew."""
    caplog.set_level(logging.INFO)
    monkeypatch.setitem(interfaces.BACKENDS, "virtual", ("tests.daemon.canbus", "FaultyBus"))
    with (
        can.Bus(request.node.name, interface="virtual") as monitor,
        closing(CanSink(JOINTS, options(request.node.name))),
    ):
        for code in (None, errno.ENOBUFS) * 4:
            monkeypatch.setattr(FaultyBus, "error_code", code)
            while (monitor.recv(0.3) is None) is (code is None):
                pass
    assert [caplog.text.count(words) for words in ("trying again", "open, node")] == [1, 2]


def test_a_wait_tells_whether_the_bus_has_ended_it() -> None:
    """An adapter from which nothing has come need not be read."""
    wakeup, (ours, theirs) = Wakeup(), os.pipe()
    try:
        wakeup.wake()
        assert not wakeup.wait(60.0, ours)
        os.write(theirs, b"t0800\r")
        assert wakeup.wait(60.0, ours)
        wakeup.wake()
        assert wakeup.wait(60.0, ours)
    finally:
        os.close(ours)
        os.close(theirs)


def test_an_adapter_is_unplugged_and_plugged_in_again(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """slcan on a pseudo-terminal: the node goes on where it was when the adapter is back, and tells what stands."""
    adapter = SlcanAdapter()
    with Emulator(adapter, link=tmp_path / "adapter") as emulator:
        given = options(emulator.paths[0], "slcan", sleep_after_open=0)
        with closing(CanSink(JOINTS, given)) as sink:
            sink.alarm(WARNING)
            wait_until(lambda: adapter.emergencies()[-1:] == [0xFF01])
            assert sink.problem == ""
            emulator.unplug()
            wait_until(lambda: "trying again" in caplog.text)
            assert sink.problem
            sink.alarm(FAULT)
            adapter.frames.clear()
            emulator.plug()
            wait_until(lambda: adapter.emergencies()[:3] == [0x0000, 0xFF01, 0xFF03])
            wait_until(lambda: (0x721, b"\x05") in adapter.frames)
            wait_until(lambda: not sink.problem)


def test_an_adapter_that_takes_nothing_holds_nobody_up() -> None:
    """Its buffer is full and nobody reads: the caller goes on, closing takes two seconds at most."""
    master, slave = os.openpty()
    tty.setraw(slave)
    sink = CanSink(JOINTS, options(os.ttyname(slave), "slcan", sleep_after_open=0))
    begin = time.monotonic()
    for _ in range(5000):
        sink.alarm(WARNING)
        sink.alarm(later(WARNING, AlarmEvent.CLEARED))
    sink.close()
    assert time.monotonic() - begin < 10.0
    os.close(master)
    os.close(slave)


def test_socketcand_over_the_network() -> None:
    """The same frames through a server on loopback, whose address stands in the options."""
    with (
        closing(SocketcandServer()) as server,
        closing(CanSink(JOINTS, options("can0", "socketcand", host="127.0.0.1", port=server.port))) as sink,
    ):
        sink.alarm(WARNING)
        wait_until(lambda: "< send 0A1 8 1 ff 81 1 ff ff ff ff >" in server.text, 60, lambda: server.text)


@pytest.mark.slow
def test_the_service_tells_its_alarms(tmp_path: Path, start: Callable[..., Running]) -> None:
    """A joint whose servo is another one: 0xFF03 with its index reaches the adapter, also after a restart."""
    adapter = SlcanAdapter()
    with Emulator(adapter) as emulator:
        table = f'[alarm.can]\ninterface = "slcan"\nchannel = "{emulator.paths[0]}"\nnode_id = 0x21\n'
        path = tmp_path / "fake.toml"
        path.write_text(
            fake_config(tmp_path, table + "options = { sleep_after_open = 0 }\n", joints=["elbow", "impostor"])
        )
        for _ in range(2):
            service = start(path)
            wait_until(lambda: 0xFF03 in adapter.emergencies())
            assert (0xA1, bytes.fromhex("03ff8101ffffffff")) in adapter.frames
            assert service.stop(signal.SIGTERM) == 0
            adapter.frames.clear()


@pytest.mark.parametrize("plugged", [True, False])
def test_the_doctor_looks_at_the_bus(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, plugged: bool) -> None:
    """An adapter that opens is good, a missing one is bad, with the likely cause."""
    monkeypatch.chdir(tmp_path)
    with Emulator(SlcanAdapter(), link=tmp_path / "adapter") as emulator:
        table = f'[alarm.can]\ninterface = "slcan"\nchannel = "{emulator.paths[0]}"\nnode_id = 1\n'
        (tmp_path / "robot.toml").write_text(SIMULATED + table + "options = { sleep_after_open = 0 }\n")
        if not plugged:
            emulator.unplug()
        result = call("doctor", "--config", tmp_path / "robot.toml", "--json")
    (check,) = [check for check in json.loads(result.stdout)["checks"] if check["check"] == "CAN bus"]
    assert (check["ok"], check["value"]) == (plugged, "opens" if plugged else "does not open")
    assert ("plugged in" in check["cause"]) is not plugged
