"""The emulators: their motion, their command line, and what a program that talks to them finds."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from dynamixel_sdk import COMM_RX_TIMEOUT, COMM_SUCCESS, Protocol1PacketHandler, Protocol2PacketHandler

from lostmotion.detector.series import score_series
from lostmotion.detector.window import DetectorSettings
from lostmotion.drivers.dynamixel_port import BusPort
from lostmotion.drivers.emulator import CsvStream, Emulator, Motion, ServoLine, WitMotionStream
from lostmotion.drivers.emulator.motion import PLAY_RAD
from tests.drivers.rigs import accelerometer, block, servo_bus

MODULE = [sys.executable, "-m", "lostmotion.drivers.emulator"]


@contextmanager
def serving(*arguments: str) -> Iterator[tuple[subprocess.Popen[str], list[str]]]:
    """The command line in a process of its own, and the two ports that it prints; gone afterwards, whatever fails.

    It hears Ctrl-C also where the tests do not: what is started in the background inherits that SIGINT is ignored.
    """
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        process = subprocess.Popen([*MODULE, *arguments], stdout=subprocess.PIPE, text=True)
    finally:
        signal.signal(signal.SIGINT, before)
    with process:
        assert process.stdout is not None
        try:
            yield process, [process.stdout.readline().strip() for _ in range(2)]
        finally:
            process.kill()


@contextmanager
def line(model: str, ids: list[int]) -> Iterator[BusPort]:
    """A port with servos, for ROBOTIS's own packet handlers."""
    with Emulator(ServoLine.of(model, ids, Motion())) as emulator:
        port = BusPort(emulator.paths[0], 1_000_000)
        port.open()
        yield port
        port.close()


def test_the_sdk_talks_to_protocol_1() -> None:
    """ROBOTIS's own packet handler pings, reads and writes the emulated AX-12A; a foreign id stays silent."""
    sdk = Protocol1PacketHandler()
    with line("AX-12A", [5]) as port:
        assert sdk.ping(port, 5) == (12, COMM_SUCCESS, 0)
        assert sdk.ping(port, 6)[1] == COMM_RX_TIMEOUT
        assert sdk.write2ByteTxRx(port, 5, 30, 700) == (COMM_SUCCESS, 0)
        assert sdk.read2ByteTxRx(port, 5, 36) == (700, COMM_SUCCESS, 0)
        assert sdk.write2ByteTxRx(port, 5, 14, 0)[1] & 0x08, "writing elsewhere is a range error"
        assert sdk.reboot(port, 5)[0] != COMM_SUCCESS


def test_the_sdk_talks_to_protocol_2() -> None:
    """The same for the emulated XM430, whose ping tells the model and whose goal has four bytes."""
    sdk = Protocol2PacketHandler()
    with line("XM430-W350", [5]) as port:
        assert sdk.ping(port, 5) == (1020, COMM_SUCCESS, 0)
        assert sdk.write4ByteTxRx(port, 5, 116, 1234) == (COMM_SUCCESS, 0)
        assert sdk.read4ByteTxRx(port, 5, 132) == (1234, COMM_SUCCESS, 0)
        assert Protocol1PacketHandler().ping(port, 5)[1] == COMM_RX_TIMEOUT


def test_play_rings_after_reversals() -> None:
    """With play, the 0.1 s after a reversal hold ten times as much of 58 Hz as without."""
    motion = Motion(play=1.0)
    starts = ((motion.reversals() + 0.005) * 1000).astype(int)
    windows = np.arange(100) + starts[starts < 19_900][:, None]
    carrier = np.hanning(100) * np.exp(-2j * np.pi * 0.058 * np.arange(100))
    loud, quiet = (np.median(np.abs(Motion(play).tip(1000)[windows] @ carrier)) for play in (1.0, 0.0))
    assert len(windows) > 60
    assert loud > 10 * quiet


@pytest.mark.slow
def test_the_play_is_that_of_the_tip() -> None:
    """The detector tells the gap from the emulated tip and the goals: the median to a sixth, for 2 and 4 mrad."""
    times, polls = np.arange(20_000) / 1000, np.arange(1990) / 100
    settings = DetectorSettings(f_res_hz=58.0, flank_exponent=1e4, noise_ms2=0.05)
    for play in (0.5, 1.0):
        motion = Motion(play)
        scores = score_series(polls, [motion.goal(time) for time in polls], times, motion.tip(1000), settings)
        told = [score.play for score in scores if np.isfinite(score.play)]
        assert len(told) > 0.5 * len(scores)
        assert np.median(told) == pytest.approx(play * PLAY_RAD, rel=1 / 6)


def test_all_servos_move_the_tip() -> None:
    """Without play: each servo's acceleration times its lever arm, the first one 1.7 s ahead, to 3 %."""
    motion, times = Motion(0.0, levers=(0.25, 0.10)), np.arange(2000) / 1000 + 1e-4
    goal = np.array([[motion.goal(t + d) for d in (-0.02, 0.0, 0.02, 1.68, 1.7, 1.72)] for t in times])
    felt = (
        0.10 * (goal[:, 0] - 2 * goal[:, 1] + goal[:, 2]) + 0.25 * (goal[:, 3] - 2 * goal[:, 4] + goal[:, 5])
    ) / 4e-4
    assert motion.tip(1000)[:2000] == pytest.approx(felt, abs=0.03 * np.abs(felt).max() + 5 * 0.05)


def test_the_motion_repeats_without_a_jump() -> None:
    """Goal and tip go on smoothly from the end of the table to its beginning."""
    motion = Motion(play=0.0)
    goal = [motion.goal(t) for t in (19.998, 19.999, 20.0, 20.001)]
    assert np.diff(goal) == pytest.approx(np.diff(goal)[0], rel=0.05)


def test_impacts_follow_the_reversals_of_the_servo_on_the_same_clock() -> None:
    """A servo line and an accelerometer share one time: the tip's slow part is 0.1 m times the goal's acceleration."""
    motion = Motion(play=0.0)
    with Emulator(ServoLine.of("XL330-M288", [1], motion), CsvStream(motion, 1000)) as emulator:
        bus = servo_bus(emulator.paths[0], [1], "XL330-M288")
        sensor = accelerometer("csv_serial", emulator.paths[1], 1000, time_column=0)
        bus.open()
        sensor.open()
        got = block(sensor, 800)
        sample = bus.read().samples[0]
        sensor.close()
        bus.close()
    assert sample.command == pytest.approx(motion.goal(sample.time), abs=0.03)
    felt = np.array([(motion.goal(t + 0.02) - 2 * motion.goal(t) + motion.goal(t - 0.02)) / 0.02**2 for t in got.time])
    assert np.corrcoef(felt, got.accel)[0, 1] > 0.98


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_the_command_line_serves_until_killed(tmp_path: Path, number: signal.Signals) -> None:
    """It prints one port a device, makes the links, answers on them, and ends by a signal with nothing left behind."""
    link = tmp_path / "port"
    arguments = ["--servos", "ax12:1,2", "--accel", "witmotion:200", "--link", str(link)]
    with serving(*arguments) as (process, ports):
        assert ports == [f"{link}.0", f"{link}.1"]
        bus, sensor = servo_bus(ports[0], [1, 2]), accelerometer("witmotion", ports[1], 200)
        bus.open()
        sensor.open()
        assert [i.ok for i in (*bus.identify(), *sensor.identify())] == [True, True, True]
        bus.close()
        sensor.close()
        process.send_signal(number)
        assert process.wait(60) == 0
    assert list(tmp_path.iterdir()) == []


def test_the_command_line_knows_feetech_servos() -> None:
    """sts3215 by its short name, SCS0009 by its own, each line a port."""
    with serving("--servos", "sts3215:1,2", "--servos", "SCS0009:7") as (process, ports):
        buses = [servo_bus(ports[0], [1, 2], "STS3215"), servo_bus(ports[1], [7], "SCS0009")]
        for bus in buses:
            bus.open()
            assert all(identity.ok for identity in bus.identify())
            bus.close()
        process.send_signal(signal.SIGTERM)
        assert process.wait(60) == 0


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "nothing to emulate"),
        (["--servos", "ax13:1"], "no servo is called 'ax13'"),
        (["--servos", "ax12:one"], "ids are whole numbers"),
        (["--accel", "csv:fast"], "the rate is a number"),
        (["--accel", "csv:1000", "--levers", "a"], "lever arms are numbers in metres"),
        (["--accel", "gyro:10"], "no accelerometer is called 'gyro'"),
    ],
)
def test_a_wrong_call_is_explained(arguments: list[str], message: str) -> None:
    """Exit status 2 and a line that says what was expected."""
    done = subprocess.run([*MODULE, *arguments], capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 2
    assert message in done.stderr


def test_a_terminal_shows_what_is_where() -> None:
    """A line for each port, with its device; what reads a pipe gets the bare ports."""
    master, slave = os.openpty()
    with subprocess.Popen([*MODULE, "--servos", "ax12:2,3", "--accel", "csv:1000"], stdout=slave) as process:
        try:
            text = ""
            while text.count("\n") < 2:
                text += os.read(master, 1000).decode()
        finally:
            process.kill()
    os.close(slave)
    os.close(master)
    servos, accelerometer = (line.split("  ") for line in text.splitlines())
    assert (servos[1], accelerometer[1]) == ("servos ax12:2,3", "accelerometer csv:1000")
    assert all(port.startswith("/dev/pts/") for port, _ in (servos, accelerometer))


def test_a_sensor_that_was_off_does_not_catch_up() -> None:
    """After a pause of an hour a stream sends from now on, not an hour of samples."""
    stream = WitMotionStream(Motion(), 200)
    stream.emit(100.0)
    assert len(stream.emit(3700.0)) <= 11
    assert 10 * 11 <= len(stream.emit(3700.1)) <= 30 * 11
