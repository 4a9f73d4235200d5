"""record and doctor through the real drivers, on hardware emulated byte by byte."""

from __future__ import annotations

import json
import threading
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lostmotion.daemon.commands.checks_devices import NOISE_MS2, white_noise
from lostmotion.drivers.codec.servo_state import MODELS
from lostmotion.drivers.emulator import Emulator, Motion, ServoLine, TextStream, WitMotionStream
from lostmotion.drivers.recording import read_recording
from tests.daemon.cli_world import HARDWARE, call
from tests.daemon.conftest import wait_until
from tests.drivers.rigs import Witness, wait_long


@dataclass(frozen=True)
class Arm:
    """An emulated arm, the configuration that names its ports, and when its servo told its state."""

    emulator: Emulator
    config: Path
    servo: Witness


@pytest.fixture
def arm(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Arm]:
    """One AX-12A with id 3 and a WitMotion sensor at 200 Hz."""
    monkeypatch.chdir(tmp_path)
    wait_long(monkeypatch)
    motion = Motion()
    line = ServoLine.of("AX-12A", [3], motion)
    servo = Witness(line.servos[3])
    with Emulator(line, WitMotionStream(motion)) as emulator:
        yield Arm(emulator, configuration(tmp_path, emulator), servo)


def configuration(folder: Path, emulator: Emulator) -> Path:
    """HARDWARE with the emulator's ports."""
    servos, sensor = emulator.paths
    path = folder / "robot.toml"
    path.write_text(HARDWARE.replace("no-such-port-0", servos).replace("no-such-port-1", sensor))
    return path


def checks(config: Path) -> dict[tuple[str, str], Any]:
    """The doctor's checks by subject and name."""
    found = json.loads(call("doctor", "--config", config, "--json").stdout)
    return {(check["subject"], check["check"]): check for check in found["checks"]}


def test_recording_of_hardware(arm: Arm) -> None:
    """Both devices are measured at their rates, in one order, each answer of the servo is there, however often a busy
    machine asks it, and the detector finds windows in the recording."""
    result = call("record", "--config", arm.config, "--duration", "2.5", "-o", "r.csv")
    assert result.exit_code == 0, result.stderr
    recording = read_recording("r.csv")
    servo_times, command = recording.signal("command")
    accel_times, accel = recording.signal("accel")
    told = np.array(arm.servo.commands())
    runs = np.lib.stride_tricks.sliding_window_view(told, command.size)
    assert np.abs(runs - command).max(axis=1).min() < 0.51 * MODELS["AX-12A"].step
    assert np.mean(np.diff(servo_times)) > 0.009
    assert len(accel_times) == pytest.approx(500, abs=80)
    assert np.median(np.diff(accel_times)) == pytest.approx(0.005, rel=0.05)
    assert np.ptp(command) > 0.01
    assert np.std(accel) > 0.01
    assert json.loads(call("score", "r.csv", "--config", arm.config, "--json").stdout)["windows"]


def test_unplugged_while_recording(arm: Arm) -> None:
    """The error is told, and what came before it stays."""
    recording = Path("r.csv")

    def unplug() -> None:
        wait_until(lambda: recording.exists() and recording.stat().st_size > 16_000)
        arm.emulator.unplug(1)

    pull = threading.Thread(target=unplug)
    pull.start()
    result = call("record", "--config", arm.config, "--duration", "30", "-o", "r.csv")
    pull.join()
    assert result.exit_code == 2
    assert "went away" in result.stderr.splitlines()[-1]
    assert read_recording("r.csv").duration > 0.3


def test_doctor_on_healthy_hardware(arm: Arm) -> None:
    """Devices are named, nothing about them is bad, and their rates are measured: that of the servo is 100 Hz, or how
    often a busy machine lets it answer."""
    found = checks(arm.config)
    rates = found["elbow", "poll rate"]["value"], found["tip", "sample rate"]["value"]
    assert "AX-12A" in found["elbow", "identity"]["value"]
    assert rates == (pytest.approx(1 / np.mean(np.diff(arm.servo.times)), rel=0.1), pytest.approx(200, rel=0.05))
    assert rates[0] < 105
    devices = [check for (subject, what), check in found.items() if subject in ("elbow", "tip") and "rate" not in what]
    assert len(devices) > 4
    assert all(check["ok"] for check in devices), devices  # a rate suffers from what else this machine does


@pytest.mark.slow
def test_doctor_says_what_cannot_be_told(arm: Arm) -> None:
    """200 samples a second of a bar of 58 Hz tell no size: a note in the table's wake and in JSON, nothing bad."""
    note = "the size of the play cannot be estimated: found 3.4 samples a period of the bar (200 Hz, bar of 58 Hz)"
    found = json.loads(call("doctor", "--config", arm.config, "--json").stdout)
    assert any(note in told for told in found["notes"])
    assert (found["robot"], found["config"]) == ("arm2", str(arm.config))
    assert f"note: accelerometer 'tip': {note}" in call("doctor", "--config", arm.config).stdout


@pytest.mark.slow
def test_doctor_says_that_it_looks_at_no_hardware(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Without a configuration it is the simulated robot's turn, which a note tells."""
    monkeypatch.setattr("lostmotion.daemon.commands.where.ETC", tmp_path / "none.toml")
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    result = call("doctor", "--json")
    found = json.loads(result.stdout)
    assert "measuring the built-in simulated robot" in result.stderr
    assert found["config"] is None
    assert "so this was the simulated robot that is built in" in found["notes"][-1]


def test_a_ringing_bar_is_no_noise() -> None:
    """Any three seconds of a worn joint's bar, whose noise is 0.05 m/s², are well within what the doctor allows; noise
    itself is measured."""
    tip = Motion().tip(200)
    pieces = [tip[start : start + 600] for start in range(0, tip.size - 600, 100)]
    assert max(white_noise(piece) for piece in pieces) < 0.8 * NOISE_MS2[1]
    hiss = np.random.default_rng(3).normal(0, 3.0, (20, 600))
    assert np.median([white_noise(piece) for piece in hiss]) == pytest.approx(3.0, rel=0.15)
    assert np.isnan(white_noise(tip[:100]))


@pytest.mark.slow
def test_doctor_names_the_wrong_device(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Another servo model, and a GPS receiver where a sensor should be: both are bad, with what was found."""
    monkeypatch.chdir(tmp_path)
    with Emulator(ServoLine.of("AX-18A", [3], Motion()), TextStream()) as emulator:
        config = configuration(tmp_path, emulator)
        result = call("doctor", "--config", config, "--json")
        found = json.loads(result.stdout)["checks"]
    assert result.exit_code == 1
    bad = [f"{check['check']} {check['value']} {check['cause']}" for check in found if not check["ok"]]
    silent = {check["check"]: check for check in found if check["subject"] == "tip"}
    assert set(silent) == {"identity", "samples"}
    assert silent["samples"]["cause"] == silent["identity"]["cause"] != ""
    assert any("AX-18A" in text for text in bad), bad
    assert any(emulator.paths[1] in text or "tip" in text for text in map(str, found)), found
