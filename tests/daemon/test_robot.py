"""Devices of a robot and what is said of them: real drivers on pseudo-terminals."""

from __future__ import annotations

import logging
import math
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from lostmotion.daemon import config
from lostmotion.daemon.poller import INBOX_READINGS, AccelPoller, DeviceState
from lostmotion.daemon.records import Origin
from lostmotion.daemon.ring import Ring
from lostmotion.daemon.robot import Robot
from lostmotion.daemon.waker import Waker
from lostmotion.drivers.base import AccelBlock, Identity
from lostmotion.drivers.clock import CYCLE_S
from lostmotion.drivers.emulator import CsvStream, Emulator, Motion, ServoLine
from tests.daemon.cli_world import SIMULATED
from tests.daemon.conftest import wait_until
from tests.daemon.fakes import fake_config
from tests.daemon.test_service import hardware
from tests.drivers.rigs import wait_long


def test_a_wrong_device_is_told_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """A sensor where the servos should be says something else at each look: the joints' fault stays the same, and is
    their own only."""
    wait_long(monkeypatch)
    monkeypatch.setattr("lostmotion.daemon.poller.WRONG_RETRY_S", 0.05)
    motion = Motion()
    with Emulator(ServoLine.of("AX-12A", [1, 2], motion), CsvStream(motion)) as emulator:
        robot = Robot(config.load(hardware(tmp_path, *reversed(emulator.paths))))
        thread = threading.Thread(target=robot.pollers[0].run)
        thread.start()
        told: dict[str, set[str | None]] = {joint.name: set() for joint in robot.config.joints}
        end = time.monotonic() + 1.5
        while time.monotonic() < end or not all(any(texts) for texts in told.values()):
            for joint in robot.config.joints:
                told[joint.name].add(robot.fault(joint))
            time.sleep(0.01)
        robot.stop.set()
        thread.join()
    for name, texts in told.items():
        (text,) = filter(None, texts)
        assert text.startswith(f"{name}: found no answer, but bytes unasked; likely cause: another device on the port")
    errors = [record.message for record in caplog.records if record.levelno == logging.ERROR]
    assert len(errors) == len(told)


def test_a_line_that_was_bad_for_a_moment_is_no_other_device_for_long(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Servos whose answers are spoilt while they are looked for are read again at once, and not after half a minute."""
    wait_long(monkeypatch)
    motion = Motion()
    line = ServoLine.of("AX-12A", [1, 2], motion)
    with Emulator(line, CsvStream(motion)) as emulator:
        robot = Robot(config.load(hardware(tmp_path, *emulator.paths)))
        line.corrupt |= {1, 2}
        poller = robot.pollers[0]
        thread = threading.Thread(target=poller.run, daemon=True)
        thread.start()
        wait_until(lambda: poller.status.state is DeviceState.WRONG)
        line.corrupt.clear()
        wait_until(lambda: poller.status.state is DeviceState.READING, timeout_s=25)
        robot.stop.set()
        thread.join()


def test_broken_answers_of_servos_are_in_the_account(tmp_path: Path) -> None:
    """A servo whose checksums are wrong is silent, and its frames are counted as broken."""
    motion = Motion()
    line = ServoLine.of("AX-12A", [1, 2], motion)
    with Emulator(line, CsvStream(motion)) as emulator:
        robot = Robot(config.load(hardware(tmp_path, *emulator.paths)))
        poller = robot.pollers[0]
        thread = threading.Thread(target=poller.run, daemon=True)
        thread.start()
        wait_until(lambda: poller.status.samples > 0)
        line.corrupt |= {1, 2}
        wait_until(lambda: poller.status.broken >= 2 and poller.status.silent >= 2)
        robot.stop.set()
        thread.join()


@pytest.mark.usefixtures("fake_driver")
def test_a_loose_plug_is_told_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """A port that goes away and comes back five times in a second: one line for each way in which it fails, and that it
    reads again."""
    caplog.set_level(logging.INFO)
    for name in ("FIRST_RETRY_S", "LAST_RETRY_S"):
        monkeypatch.setattr(f"lostmotion.daemon.poller.{name}", 0.02)
    missing, path = tmp_path / "missing", tmp_path / "fake.toml"
    path.write_text(fake_config(tmp_path, f'[fake]\nmissing = "{missing}"\n'))
    robot = Robot(config.load(path))
    poller = robot.pollers[0]
    thread = threading.Thread(target=poller.run)
    thread.start()
    for _ in range(5):
        wait_until(lambda: poller.status.state is DeviceState.READING)
        missing.touch()
        wait_until(lambda: "is missing" in poller.status.reason)
        missing.unlink()
    robot.stop.set()
    thread.join()
    assert caplog.messages == [
        "fake: reading", "fake: retrying: the port went away", "fake: retrying: the port is missing", "fake: reading",
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("found", "put", "windows"),
    [
        ("", "[alarm]\nwindows = 10\n[detector]\nlevel = 5.0\n", 7),
        ("id = 2", "id = 3", 0),
        ("id = 2", "id = 2\nlevers_m = { tip = 0.2 }", 0),
        ("f_res_hz = 58.0", "f_res_hz = 60.0", 0),
        ("", "[detector]\nnoise_ms2 = 0.2\n", 0),
        ('name = "elbow"', 'name = "wrist"', 0),
    ],
)
def test_a_reload_keeps_which_joint_has_the_play(tmp_path: Path, found: str, put: str, windows: int) -> None:
    """The windows that were weighed stay where joints and accelerometers are the same, whatever else changes."""
    path = hardware(tmp_path, "/dev/ttyUSB0", "/dev/ttyUSB1")
    earlier = Robot(config.load(path))
    earlier.pipeline.attributors[0].origin = Origin({"elbow": 0.99, "shoulder": 0.01}, 7)
    text = path.read_text()
    path.write_text(text.replace(found, put) if found else f"{text}\n{put}")
    following = Robot(config.load(path))
    following.continue_from(earlier)
    assert following.pipeline.attributors[0].origin.windows == windows


@pytest.mark.parametrize(("rate_hz", "most"), [(200.0, 40), (1000.0, 100), (4000.0, 150)])
def test_acceleration_is_read_in_cycles(rate_hz: float, most: int) -> None:
    """When a cycle begins, and as often in between as its samples need: a tty holds about 150."""
    sensor, ring, stop = Sensor(rate_hz), Ring(20_000, Waker()), threading.Event()
    poller = AccelPoller("tip", sensor, stop, ring, 1 / rate_hz, waits=False)
    thread = threading.Thread(target=poller.run)
    thread.start()
    wait_until(lambda: len(sensor.reads) > 24)
    stop.set()
    thread.join()
    step = float(np.median(np.diff(sensor.reads)))
    assert step <= most / rate_hz + 1e-3
    assert CYCLE_S / step == pytest.approx(round(CYCLE_S / step), rel=0.05)
    late = np.array(sensor.reads) % (CYCLE_S / round(CYCLE_S / step))
    assert np.median(late) < 0.01


def test_messages_that_wait_are_read_at_once() -> None:
    """Of a driver that hands on one of 100 messages a second each time, none falls behind."""
    ring, stop, begin = Ring(20_000, Waker()), threading.Event(), time.monotonic()
    poller = AccelPoller("tip", Messages(1000.0, begin), stop, ring, 1e-3, waits=False)
    thread = threading.Thread(target=poller.run)
    thread.start()
    wait_until(lambda: ring.newest > begin + 1.0)
    late = time.monotonic() - ring.newest
    stop.set()
    thread.join()
    assert late < 2 * CYCLE_S


class Sensor:
    """Notes when it is read [s]."""

    range_ms2 = math.inf

    def __init__(self, rate_hz: float) -> None:
        self.rate_hz, self.reads = rate_hz, list[float]()

    def open(self) -> None:
        """There is nothing to open."""

    def identify(self) -> tuple[Identity, ...]:
        return (Identity("tip", "fake", "fake", ok=True),)

    def read(self) -> AccelBlock:
        self.reads.append(time.monotonic())
        return AccelBlock(np.array(self.reads[-1:]), np.zeros(1))

    def close(self) -> None:
        """Nothing is held open."""


class Messages(Sensor):
    """Has a message of ten samples at a time, and waits where the next one is not complete."""

    def __init__(self, rate_hz: float, begin: float) -> None:
        super().__init__(rate_hz)
        self.next = begin

    def read(self) -> AccelBlock:
        stamps = self.next + np.arange(10) / self.rate_hz
        self.next = float(stamps[-1]) + 1 / self.rate_hz
        time.sleep(max(0.0, self.next - time.monotonic()))
        return AccelBlock(stamps, np.zeros(10))


def test_a_virtual_robot_does_not_run_ahead(tmp_path: Path) -> None:
    """With nobody who reads, the servos of a simulated robot wait after a few readings: what is read in one step, and
    has to be done before the service can end, is a few seconds of motion and not minutes."""
    robot = Robot(config.loads(SIMULATED.replace("history.db", f"{tmp_path}/history.db"), "simulated"))
    bus = robot.pollers[0]
    thread = threading.Thread(target=bus.run)
    thread.start()
    assert robot.inbox.waker.wait(60.0)  # by the first reading: its time may run fast
    wait_until(lambda: len(robot.inbox.servo) > INBOX_READINGS)
    time.sleep(0.3)
    assert len(robot.inbox.servo) == INBOX_READINGS + 1
    robot.stop.set()
    thread.join()
    readings = [samples for _, samples in robot.inbox.servo]
    assert readings[-1][-1].time - readings[0][0].time < 5.0
