"""Drives on a CANopen bus that are the canopen library's own nodes: values, silence, trouble, and nothing is sent."""

from __future__ import annotations

import math
import random
import time
from pathlib import Path
from typing import Any

import can
import canopen
import numpy as np
import pytest

from lostmotion.drivers.base import ServoSample
from lostmotion.drivers.emulator import CanopenLine, Emulator, Motion
from lostmotion.drivers.errors import DriverError, IdentityError, PortError
from tests.drivers.canbus import STEP, bus, dictionary, given, library_robot
from tests.drivers.rigs import until


@pytest.fixture
def channel(request: pytest.FixtureRequest) -> str:
    """A virtual bus of this test's own."""
    return str(request.node.name)


def heard(driver: Any, seconds: float = 0.5) -> list[ServoSample]:
    """All samples of some seconds."""
    end, samples = time.monotonic() + seconds, []
    while time.monotonic() < end:
        samples += driver.read().samples
    return samples


def test_the_library_nodes_values_in_si(channel: str) -> None:
    """Positions, targets, speed, torque and current of two LocalNodes, 100 a second, with the stamps of the bus."""
    with library_robot(channel) as robot:
        driver = bus(channel, rated_torque_nm=0.64, rated_current_a=2.0)
        driver.open()
        robot.start()
        identities = driver.identify()
        assert [(who.name, who.ok) for who in identities] == [("j1", True), ("j2", True)]
        assert identities[0].found == "node 1: position in 0x181, command (0x607A) in 0x201"
        samples = heard(driver, 1.0)
        driver.close()
    for node in (1, 2):
        own = [sample for sample in samples if sample.joint == f"j{node}"]
        assert 50 <= len(own) <= 130
        assert [s.time for s in own] == sorted(s.time for s in own)
        assert all(s.command - s.position == pytest.approx(10 * STEP) for s in own)
        assert max(abs(s.position) for s in own) <= 1e-3 * node + STEP
        last = own[-1]
        assert last.velocity == pytest.approx(100 * node * STEP)
        assert last.torque == pytest.approx(0.64 * 0.250 * 100)
        assert last.current == pytest.approx(-1.0)
    assert driver.resolution_rad == pytest.approx(STEP)


def test_mapping_and_units_by_sdo(channel: str) -> None:
    """Allowed to ask, it reads from the library's SDO server which bits are what, the resolution and the ratings."""
    with library_robot(channel) as robot:
        robot.start()
        driver = bus(channel, sdo=True)
        driver.open()
        who = driver.identify()
        assert all(one.ok for one in who), who
        assert "vendor 0x9A, product 0x77" in who[0].found
        sample = heard(driver)[-1]
        driver.close()
    assert sample.command - sample.position == pytest.approx(10 * STEP)
    assert sample.torque == pytest.approx(0.64 * 0.250 * 100)
    assert sample.current == pytest.approx(-1.0)


@pytest.mark.slow
def test_without_leave_not_one_frame_is_sent(channel: str) -> None:
    """Opening, identifying, reading, with everybody there, with nobody, with trouble: the other end receives nothing of
    it; allowed to ask, it sends SDO uploads and nothing else."""
    with library_robot(channel) as robot, can.Bus(channel, interface="virtual", receive_own_messages=False) as ear:
        own = {0x80, 0x181, 0x182, 0x201, 0x202, 0x281, 0x282}
        driver = bus(channel, nodes=(1, 2, 3))
        driver.open()
        driver.identify()
        robot.start()
        driver.identify()
        heard(driver)
        driver.close()
        robot.halt()
        seen = []
        while (message := ear.recv(0.0)) is not None:
            seen.append(message)
        assert len(seen) > 100
        assert {message.arbitration_id for message in seen} <= own
        asking = bus(channel, nodes=(1,), sdo=True)
        asking.open()
        asking.close()
        asked = []
        while (message := ear.recv(0.0)) is not None:
            asked.append(message)
        ours = [message for message in asked if message.arbitration_id != 0x581]
        assert {message.arbitration_id for message in ours} == {0x601}
        assert {message.data[0] for message in ours} == {0x40}
        assert len(ours) > 10


def test_the_serial_adapter_is_only_opened(tmp_path: Path) -> None:
    """On slcan an adapter gets the commands close, speed and open, and not one frame; listen_only opens it mute."""
    for listen, word in ((False, b"O"), (True, b"L")):
        line = CanopenLine([1], Motion())
        with Emulator(line) as emulator:
            keys: dict[str, Any] = {"options": {"listen_only": True}} if listen else {}
            driver = bus(emulator.paths[0], (1,), **{"interface": "slcan", "bitrate": 500_000, **keys})
            driver.open()
            assert driver.identify()[0].ok
            heard(driver)
            driver.close()
            until(lambda line=line: len(line.commands) == 4)
        assert line.commands == [b"C", b"S6", word, b"C"]
        assert line.received == []


def test_an_eds_file_gives_the_mapping(channel: str, tmp_path: Path) -> None:
    """A file that the library exports from a node, with its values, maps as the node does."""
    od = dictionary()
    for com, par, cob, entries in (
        (0x1400, 0x1600, 0x201, (0x60400010, 0x607A0020)),
        (0x1800, 0x1A00, 0x181, (0x60410010, 0x60640020)),
    ):
        od[com][1].default = cob
        od[par][0].default = len(entries)
        for sub, entry in enumerate(entries, 1):
            od[par][sub].default = entry
    od[0x1801][1].default = 0x80000281
    path = tmp_path / "drive.eds"
    canopen.export_od(od, str(path), doc_type="eds")
    with library_robot(channel, (1,)) as robot:
        driver = bus(channel, (1,), eds=str(path))
        driver.open()
        robot.start()
        (who,) = driver.identify()
        assert who.ok
        assert who.found == "node 1: position in 0x181, command (0x607A) in 0x201"
        sample = heard(driver)[-1]
        assert sample.command - sample.position == pytest.approx(10 * STEP)
        assert math.isnan(sample.velocity)
        driver.close()


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({"pdo": []}, "no PDO mapping; expected pdo = "),
        ({"pdo": [{"cob_id": 0x181, "map": [0x60410010]}]}, "no PDO of node 1 holds the position actual value 0x6064"),
        ({"pdo": [{"cob_id": 0x181, "map": [0x60640020]}]}, "no PDO of node 1 holds the command, 0x607A or 0x6062"),
        ({"pdo": [{"cob_id": 0x181, "map": [0x60640020] * 3}]}, "found 96 bits in one PDO, expected at most 64"),
        ({"pdo": [{"cob_id": 0x181, "map": [0x60640000]}]}, "expected index, subindex and bits as in 0x60640020"),
        ({"command": "demand"}, "no PDO of node 1 holds the command"),
        ({"counts_per_turn": None}, "counts_per_turn is missing"),
        ({"gear_ratio": 0}, "gear_ratio, other than 0 is missing"),
        ({"eds": "no-such.eds", "pdo": []}, "no-such.eds cannot be read as EDS or DCF"),
        ({"interface": "sockedcan"}, "found interface 'sockedcan', expected one that python-can knows"),
        ({"interface": "slcan", "bitrate": 123}, "found bitrate 123, expected one that slcan adapters know"),
    ],
)
def test_what_cannot_work_is_refused_before_the_bus_is_opened(keys: dict[str, Any], words: str) -> None:
    """Mappings without a position or command, units that nobody gives, names that do not exist."""
    with pytest.raises(DriverError, match=words.replace("[", "\\[").split("; expected pdo")[0]):
        bus("nowhere", (1,), **{"pdo": given(1), **keys})


def test_a_node_used_twice_is_refused() -> None:
    """Two joints of one node are a slip of the file's."""
    with pytest.raises(DriverError, match="joints j1 and j1 have the same node 1"):
        bus("nowhere", (1, 1))


def test_a_missing_node_is_told_with_those_that_are_there(channel: str) -> None:
    """Node 3 is configured and not on the bus: its identity is wrong and names 1 and 2; it alone is silent."""
    with library_robot(channel) as robot:
        driver = bus(channel, (1, 2, 3))
        driver.open()
        robot.start()
        who = driver.identify()
        assert [one.ok for one in who] == [True, True, False]
        assert "node 3: no frames received (nodes seen: 1, 2" in who[2].found
        reading = driver.read()
        assert reading.silent == ("j3",)
        assert {sample.joint for sample in reading.samples} == {"j1", "j2"}
        robot.halt()
        heard(driver, 0.5)
        assert driver.read().silent == ("j1", "j2", "j3")
        driver.close()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("status", "state"),
    [(0x0650, "switch on disabled"), (0x0618, "fault"), (0x0617, "quick stop active"), (0x0631, "ready to switch on")],
)
def test_a_drive_that_follows_no_command_gives_no_sample(channel: str, status: int, state: str) -> None:
    """While it is not in Operation enabled there are no samples, and after some seconds the driver says why."""
    with library_robot(channel, (1,)) as robot:
        driver = bus(channel, (1,))
        driver.open()
        robot.cycle(0.0)
        robot.cycle(0.1)
        assert driver.identify()[0].ok
        driver.read()

        def wait() -> None:
            end = time.monotonic() + 20
            while time.monotonic() < end:
                robot.cycle(1.0, status)
                assert driver.read().samples == ()

        with pytest.raises(IdentityError, match=f"j1: node 1: {state}, follows no command"):
            wait()
        assert state in driver.identify()[0].found
        driver.close()


@pytest.mark.slow
def test_nmt_states_and_lost_heartbeats(channel: str) -> None:
    """Pre-operational is told with its likely cause; a drive that sent heartbeats and stopped is gone."""
    with library_robot(channel, (1,)) as robot:
        driver = bus(channel, (1,), heartbeat_s=2.0)
        driver.open()
        robot.start()
        robot.beat(1, 127)
        assert (
            "pre-operational, sends no PDOs; likely cause: the master has not started it" in driver.identify()[0].found
        )
        robot.beat(1, 5)
        heard(driver, 0.2)
        assert driver.identify()[0].ok
        with pytest.raises(IdentityError, match="no heartbeat for more than 2 s"):
            heard(driver, 20.0)
        driver.close()


def test_gaps_of_the_sync_counter_are_lost_polls(channel: str) -> None:
    """Three SYNCs with all that follows them are missing: three polls are lost, and none where it begins anew.  A pause
    of a busy machine is no lost poll of a drive that is polled once a second."""
    with library_robot(channel, (1,)) as robot:
        driver = bus(channel, (1,), poll_hz=1.0)
        driver.open()
        for number in range(500):
            robot.cycle(0.0, skip=3 if number == 100 else 0)
        assert driver.read().lost == 3
        driver.close()


def test_error_frames_and_bus_off(channel: str) -> None:
    """An error frame is a broken one; one that says bus off ends the reading with its likely cause."""
    with library_robot(channel, (1,)) as robot:
        driver = bus(channel, (1,))
        driver.open()
        robot.cycle(0.0)
        robot.master.send(can.Message(arbitration_id=0x08, is_error_frame=True, data=bytes(8)))
        assert driver.read().broken == 1
        robot.master.send(can.Message(arbitration_id=0x40, is_error_frame=True, data=bytes(8)))
        with pytest.raises(PortError, match="bus off; likely cause: a wrong bitrate"):
            driver.read()
        driver.close()


def test_times_are_those_of_the_bus_not_of_the_reader(channel: str) -> None:
    """Frames that wait unread for half a second keep the time at which they were sent, within milliseconds."""
    with library_robot(channel, (1,)) as robot:
        driver = bus(channel, (1,))
        driver.open()
        sent = []
        for _ in range(5):
            sent.append(time.monotonic())
            robot.cycle(0.0)
            time.sleep(0.02)
        time.sleep(0.5)
        samples = driver.read().samples
        assert [s.time for s in samples] == pytest.approx(sent, abs=0.015)
        driver.close()


@pytest.mark.parametrize("seed", range(3))
def test_any_frames_at_all_are_survived(channel: str, seed: int) -> None:
    """Random bytes of any length under the drive's own identifiers: no exception, finite positions, ascending times."""
    dice = random.Random(seed)
    with library_robot(channel, (1,)) as robot:
        driver = bus(channel, (1,))
        driver.open()
        times = []
        for _ in range(20):
            for _ in range(100):
                robot.send(dice.choice((0x80, 0x81, 0x181, 0x201, 0x281, 0x701)), dice.randbytes(dice.randrange(9)))
            try:
                samples = driver.read().samples
            except IdentityError:
                continue
            assert np.isfinite([(s.position, s.command) for s in samples]).all()
            times += [s.time for s in samples]
        assert times == sorted(set(times))
        driver.close()
