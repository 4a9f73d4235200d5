"""``lostmotion doctor --find`` on emulated hardware that is understood at its own baud rate only."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest

from lostmotion.daemon import config
from lostmotion.daemon.commands.find_config import configuration
from lostmotion.drivers.codec.dynamixel import PING, READ, decoder
from lostmotion.drivers.emulator import (
    CsvStream,
    Device,
    Emulator,
    FeetechLine,
    Motion,
    ServoLine,
    TextStream,
    WitMotionStream,
)
from lostmotion.drivers.probe.kernel import can_interfaces, iio_accelerometers, nodes
from lostmotion.drivers.probe.port import Look
from lostmotion.drivers.probe.servos import FoundServo
from tests.daemon.cli_world import PROGRAM, call, is_one_line

MOTION = Motion()


class Spied(ServoLine):
    """A line of servos that keeps all bytes that reach it."""

    heard = b""

    def receive(self, data: bytes, now: float) -> None:
        self.heard += data
        super().receive(data, now)


def found(folder: Path, device: Device, baudrate: int | None, name: str = "found") -> dict[str, Any]:
    """The document about one port, with the configuration written to ``name``.toml."""
    with Emulator(device, link=folder / name, baudrate=baudrate) as emulator:
        target = folder / f"{name}.toml"
        arguments = ["doctor", "--find", "--port", emulator.paths[0], "-o", str(target), "--json"]
        done = subprocess.run([*PROGRAM, *arguments], capture_output=True, text=True, timeout=300, check=False)
    assert "Traceback" not in done.stderr
    document: dict[str, Any] = json.loads(done.stdout)
    document["status"] = done.returncode
    return document


def servos(document: dict[str, Any]) -> list[tuple[str, int, str, int]]:
    """Driver, id, model and baud rate of the servos of the only port."""
    (port,) = document["ports"]
    return [(each["driver"], each["id"], each["model"], each["baudrate"]) for each in port["servos"]]


def is_valid(path: Path) -> bool:
    """Whether ``config check`` takes a file as it is."""
    return call("config", "check", path).exit_code == 0


@pytest.mark.slow
def test_servos_at_their_baud_rates(tmp_path: Path) -> None:
    """Three XL330 at 57600, six STS3215 at 1 Mbaud, two AX-12A at 115200 and a SCS0009 at 500000 are all found, with
    nothing else; the files written are valid and name LeRobot's joints where they are.  Every packet that the AX-12A's
    line hears is a ping or a read."""
    spied = Spied.of("AX-12A", [3, 252], MOTION)
    lines: Sequence[tuple[str, Device, int]] = (
        ("x", ServoLine.of("XL330-M288", [1, 7, 200], MOTION), 57_600),
        ("sts", FeetechLine.of("STS3215", range(1, 7), MOTION), 1_000_000),
        ("ax", spied, 115_200),
        ("scs", FeetechLine.of("SCS0009", [5], MOTION), 500_000),
    )
    with ThreadPoolExecutor() as pool:
        x, sts, ax, scs = pool.map(lambda line: found(tmp_path, line[1], line[2], line[0]), lines)
    assert servos(x) == [("dynamixel", id, "XL330-M288", 57_600) for id in (1, 7, 200)]
    assert servos(sts) == [("feetech", id, "STS3215", 1_000_000) for id in range(1, 7)]
    assert servos(ax) == [("dynamixel", id, "AX-12A", 115_200) for id in (3, 252)]
    assert servos(scs) == [("feetech", 5, "SCS0009", 500_000)]
    assert [document["status"] for document in (x, sts, ax, scs)] == [0] * 4
    assert all(is_valid(tmp_path / f"{name}.toml") for name, _, _ in lines)
    codes = {packet.code for protocol in (1, 2) for packet in decoder(protocol).feed(spied.heard) if packet}
    assert codes == {PING, READ}
    arm = config.load(tmp_path / "sts.toml")
    assert [joint.name for joint in arm.joints][::5] == ["shoulder_pan", "gripper"]
    assert {joint.poll_hz for joint in arm.joints} == {100.0}
    assert {joint.port for joint in arm.joints} == {str(tmp_path / "sts.0")}


@pytest.mark.slow
def test_sensors_are_known_without_a_byte_sent(tmp_path: Path) -> None:
    """A WitMotion at 9600 baud and a microcontroller's lines at 460800: driver, baud rate, rate within 3 %, the clock's
    column and unit."""
    with ThreadPoolExecutor() as pool:
        wit = pool.submit(found, tmp_path, WitMotionStream(MOTION, 100), 9_600, "wit")
        csv = pool.submit(found, tmp_path, CsvStream(MOTION, 800), 460_800, "csv")
        (first,), (second,) = wit.result()["ports"], csv.result()["ports"]
    assert (first["sensor"]["driver"], first["sensor"]["baudrate"]) == ("witmotion", 9_600)
    assert first["sensor"]["rate_hz"] == pytest.approx(100, rel=0.03)
    assert (second["sensor"]["driver"], second["sensor"]["baudrate"]) == ("csv_serial", 460_800)
    assert second["sensor"]["rate_hz"] == 800
    assert second["sensor"]["options"] == {"time_column": 0, "time_unit": "us", "column": 1}
    assert is_valid(tmp_path / "wit.toml")
    assert is_valid(tmp_path / "csv.toml")


@pytest.mark.slow
def test_other_devices_are_described_and_asked_nothing(tmp_path: Path) -> None:
    """A GPS receiver is told by its bytes a second and first letters; a dead port as silent; neither makes a file."""
    gps = TextStream()
    asked: list[bytes] = []
    gps.receive = lambda data, now: asked.append(data)  # type: ignore[method-assign]
    with ThreadPoolExecutor() as pool:
        one = pool.submit(found, tmp_path, gps, 9_600, "gps")
        two = pool.submit(found, tmp_path, TextStream(b""), None, "dead")
        (talking,), (dead,) = one.result()["ports"], two.result()["ports"]
    assert talking["chatter"]["baudrate"] == 9_600
    assert talking["chatter"]["printable"] == 1.0
    assert talking["chatter"]["bytes_per_s"] == pytest.approx(690, rel=0.3)
    assert asked == []
    assert (dead["servos"], dead["sensor"], dead["chatter"], dead["complete"]) == ([], None, None, True)
    assert (one.result()["status"], two.result()["status"]) == (1, 1)
    assert not list(tmp_path.glob("*.toml"))


def test_a_port_in_use_is_named_and_left_alone(tmp_path: Path) -> None:
    """The process that has the port open is told, and not a byte is sent."""
    line = Spied.of("AX-12A", [1], MOTION)
    holder = "import sys, time; port = open(sys.argv[1], 'rb', buffering=0); print('open', flush=True); time.sleep(60)"
    with Emulator(line, link=tmp_path / "tty") as emulator:
        path = emulator.paths[0]
        other = subprocess.Popen([sys.executable, "-c", holder, path], stdout=subprocess.PIPE, text=True)
        assert other.stdout is not None
        assert other.stdout.readline() == "open\n"
        try:
            told = call("doctor", "--find", "--port", path)
            document = json.loads(call("doctor", "--find", "--port", path, "--json").stdout)
        finally:
            other.kill()
            other.wait()
    (port,) = document["ports"]
    assert told.exit_code == 1
    assert f"in use by {other.pid} (" in told.stdout
    assert not port["probed"]
    assert port["users"][0].startswith(f"{other.pid} (")
    assert line.heard == b""


def test_a_missing_port_is_told(tmp_path: Path) -> None:
    """A port that is not there: what is wrong stands in the table, and the status is 1."""
    told = call("doctor", "--find", "--port", tmp_path / "ttyUSB9")
    assert told.exit_code == 1
    assert "does not exist" in told.stdout


def test_wrong_calls_are_refused(tmp_path: Path) -> None:
    """A file that exists is not written over; --port wants --find; --find wants no --config."""
    (tmp_path / "robot.toml").write_text("mine")
    assert is_one_line(call("doctor", "--find", "-o", tmp_path / "robot.toml"), "expected a new one")
    assert (tmp_path / "robot.toml").read_text() == "mine"
    assert call("doctor", "--port", "/dev/null").exit_code == 2
    assert call("doctor", "--find", "--config", "robot.toml").exit_code == 2


def test_servos_of_two_baud_rates_and_of_unknown_model(tmp_path: Path) -> None:
    """Two ports with equal ids get names of their own; a servo of unknown model or another baud rate is a comment."""
    twelve = [FoundServo("dynamixel", id, "AX-12A", 12, 1, 1_000_000) for id in (1, 2)]
    odd = FoundServo("dynamixel", 3, "", 4242, 2, 1_000_000)
    new = FoundServo("dynamixel", 9, "XL330-M288", 1200, 2, 57_600)
    text = configuration([("/dev/ttyUSB0", Look((new, *twelve, odd))), ("/dev/ttyUSB1", Look(tuple(twelve)))])
    robot = config.loads(text, "robot.toml")
    assert [joint.name for joint in robot.joints] == ["line1_joint1", "line1_joint2", "line2_joint1", "line2_joint2"]
    assert "# id 3: model number 4242" in text
    assert "# left out: dynamixel XL330-M288, id 9, at 57600 baud" in text
    assert configuration([("/dev/ttyUSB0", Look((odd,)))]) == ""


def test_what_the_kernel_knows(tmp_path: Path) -> None:
    """From a sysfs: a CAN interface that is down and how to bring it up, an accelerometer and no thermometer; nodes by
    their heartbeats."""
    (tmp_path / "net" / "can7").mkdir(parents=True)
    (tmp_path / "net" / "can7" / "type").write_text("280\n")
    (tmp_path / "net" / "can7" / "flags").write_text("0x80\n")
    (tmp_path / "net" / "eth0").mkdir()
    (tmp_path / "net" / "eth0" / "type").write_text("1\n")
    (tmp_path / "net" / "can8" / "type").mkdir(parents=True)  # cannot be read, as of an adapter that is just unplugged
    (can,) = can_interfaces(tmp_path / "net")
    assert (can.name, can.up) == ("can7", False)
    assert "ip link set can7 up" in can.error
    for number, name, channel in ((0, "adxl355", "in_accel_x_raw"), (1, "bme280", "in_temp_raw")):
        device = tmp_path / "iio" / f"iio:device{number}"
        device.mkdir(parents=True)
        (device / "name").write_text(f"{name}\n")
        (device / channel).write_text("0\n")
    assert [(chip.device, chip.name) for chip in iio_accelerometers(tmp_path / "iio")] == [("iio:device0", "adxl355")]
    assert nodes([0x80, 0x181, 0x701, 0x77F, 0x780, 0x701]) == (1, 127)


@pytest.mark.slow
def test_a_port_without_a_baud_rate(tmp_path: Path) -> None:
    """Servos that answer alike at three baud rates are told once, at the most usual one, and the search ends."""
    document = found(tmp_path, FeetechLine.of("STS3215", [1, 2], MOTION), None)
    assert servos(document) == [("feetech", id, "STS3215", 1_000_000) for id in (1, 2)]
    assert is_valid(tmp_path / "found.toml")
