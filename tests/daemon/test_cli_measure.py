"""config check, record, score and doctor on the simulated robot and on files."""

from __future__ import annotations

import json
import math
import os
import re
import resource
import sqlite3
import subprocess
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lostmotion.daemon import config as configuration
from lostmotion.daemon.commands.checks import within
from lostmotion.daemon.commands.checks_system import (
    check_adapters,
    check_clock,
    check_disk,
    check_history,
    clock_offset,
)
from lostmotion.daemon.records import JointRow
from lostmotion.daemon.store import Store
from lostmotion.drivers.emulator import Emulator, Motion, WitMotionStream
from lostmotion.drivers.recording import read_recording
from tests.daemon.cli_world import HARDWARE, PROGRAM, SECOND_JOINT, SIMULATED, call, fill, is_one_line


@pytest.fixture
def robot(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The configuration of a simulated robot, in a folder of its own."""
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "robot.toml"
    path.write_text(SIMULATED)
    return path


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Four seconds of the simulated elbow, as `record` writes them."""
    folder = tmp_path_factory.mktemp("recording")
    (folder / "robot.toml").write_text(SIMULATED)
    result = call("record", "--config", folder / "robot.toml", "--duration", "4", "-o", folder / "elbow.csv")
    assert result.exit_code == 0, result.stderr
    return folder / "elbow.csv"


def documents(result: Any) -> Any:
    """The one JSON document on stdout."""
    return json.loads(result.stdout)


def test_config_check(robot: Path) -> None:
    """A valid configuration is shown as it is in force, defaults and all."""
    found = documents(call("config", "check", robot, "--json"))
    assert (found["valid"], found["robot"], found["database"]) == (True, "arm1", "history.db")
    (joint,) = found["joints"]
    assert (joint["name"], joint["detector"]["level"], joint["detector"]["f_res_hz"]) == ("elbow", 5.5, 58.0)
    text = call("config", "check", robot).stdout
    assert text.startswith(f"{robot}: valid\n")
    assert [line.split() for line in text.splitlines() if line.startswith("level")] == [["level", "5.5"]]


def test_config_check_refuses(robot: Path) -> None:
    """An unknown key is one line that names the near one."""
    robot.write_text(SIMULATED.replace("level", "levle"))
    assert is_one_line(call("config", "check", robot), "levle", "level")


def test_recording_holds_both_devices_in_order(recording: Path) -> None:
    """Servo and accelerometer at their own rates, from 0 to the duration asked for, and what score needs to know."""
    found = read_recording(recording)
    command_times, _ = found.signal("command")
    accel_times, accel = found.signal("accel")
    assert 3.9 < found.duration < 4.0
    assert np.median(np.diff(command_times)) == pytest.approx(0.01)
    assert np.median(np.diff(accel_times)) == pytest.approx(0.001)
    assert len(accel) == 4000
    assert found.metadata["resolution_rad"] == pytest.approx(np.radians(300) / 1023)
    assert found.metadata["range_ms2"] == pytest.approx(156.9)
    assert {key: found.metadata[key] for key in ("robot", "joint", "f_res_hz", "zeta")} == {
        "robot": "arm1", "joint": "elbow", "f_res_hz": 58.0, "zeta": 0.012,
    }  # fmt: skip


def test_record_wants_one_joint(robot: Path) -> None:
    """With several joints one has to be chosen, and then only its devices are used."""
    robot.write_text(SIMULATED + SECOND_JOINT)
    arguments = ["record", "--config", str(robot), "--duration", "0.5", "-o", "r.csv"]
    assert is_one_line(call(*arguments), "--joint", "elbow, wrist")
    assert is_one_line(call(*arguments, "--joint", "knee"), "knee", "wrist")
    assert not Path("r.csv").exists()
    result = call(*arguments, "--joint", "wrist")
    assert result.exit_code == 0
    assert "note: elbow also moves tip; hold it still" in result.stderr
    found = read_recording("r.csv").metadata
    assert (found["joint"], found["also_moved_by"]) == ("wrist", ["elbow"])


def test_score_says_whose_impacts_there_may_be(robot: Path, caplog: pytest.LogCaptureFixture) -> None:
    """A recording of a joint whose accelerometer another joint moves is scored with a warning; one of a joint with a
    sensor of its own without."""
    robot.write_text(SIMULATED + SECOND_JOINT)
    assert call("record", "--config", robot, "--duration", "2", "-o", "r.csv", "--joint", "wrist").exit_code == 0
    result = call("score", "r.csv", "--json")
    assert (result.exit_code, json.loads(result.stdout)["joint"]) == (0, "wrist")
    assert "r.csv: the accelerometer is also moved by elbow: impacts and play are those of wrist only" in caplog.text
    caplog.clear()
    robot.write_text(SIMULATED)
    assert call("record", "--config", robot, "--duration", "2", "-o", "r.csv").exit_code == 0
    assert call("score", "r.csv").exit_code == 0
    assert caplog.text == ""


def test_an_accelerometer_alone_is_recorded_and_calibrated(robot: Path) -> None:
    """The first step of calibrating: no servo is opened, which may be missing, also in the configuration, and calibrate
    tap takes the file; a name that is not there, and a joint beside it, are refused."""
    with Emulator(WitMotionStream(Motion(play=0.0))) as emulator:  # an impact of the gears would ring as a tap does
        robot.write_text(HARDWARE.replace("no-such-port-1", emulator.paths[0]))
        arguments = ["record", "--config", str(robot), "--duration", "1", "-o", "taps.csv"]
        result = call(*arguments, "--accelerometer", "tip")
        robot.write_text(robot.read_text().partition("[[joint]]")[0])
        assert call(*arguments, "--accelerometer", "tip").exit_code == 0
        assert is_one_line(call(*arguments), "[[joint]] is missing; expected at least one such table")
        robot.write_text(HARDWARE)
    assert result.exit_code == 0, result.stderr
    assert "rows of accelerometer tip" in result.stderr
    found = read_recording("taps.csv")
    assert 50 < found.signal("accel")[0].size < 230  # 200 Hz; a busy machine hands the first of them over late
    assert found.metadata["accelerometer"] == "tip"
    assert "joint" not in found.metadata
    assert is_one_line(call("calibrate", "tap", "taps.csv"), "taps.csv", "expected")
    assert is_one_line(call(*arguments, "--accelerometer", "tap"), "found 'tap', expected one of tip")
    assert is_one_line(call(*arguments, "--accelerometer", "tip", "--joint", "elbow"), "expected one of them")


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ("lostmotion history e", ["elbow"]),
        ("lostmotion record --config robot.toml --joint ", ["elbow", "wrist"]),
        ("lostmotion record --config robot.toml --accelerometer ", ["tip"]),
        ("lostmotion alarms ack --config robot.toml w", ["wrist"]),
        ("lostmotion history --config broken.toml ", []),
        ("lostmotion history --database other.db ", ["knee"]),
        ("lostmotion history --config robot.toml --database other.db ", ["elbow", "wrist", "knee"]),
    ],
)
def test_names_are_completed(robot: Path, words: str, expected: list[str]) -> None:
    """What a shell asks for at the end of these words, in a process as the shell starts it."""
    robot.write_text(SIMULATED + SECOND_JOINT)
    Path("broken.toml").write_text("[robot")
    with closing(Store(Path("other.db"), "arm2")) as other:
        other.add(JointRow("knee"))
    environment = {"_LOSTMOTION_COMPLETE": "bash_complete", "COMP_WORDS": words, "COMP_CWORD": str(words.count(" "))}
    done = subprocess.run(PROGRAM, env=os.environ | environment, capture_output=True, text=True)
    assert done.stderr == ""
    assert [line.partition(",")[2] for line in done.stdout.split()] == expected


def test_record_json(robot: Path) -> None:
    """One document says what was measured: file, joint, rows, length and the rates of both devices."""
    result = call("record", "--config", robot, "--duration", "1.5", "-o", "r.csv", "--json")
    assert re.search(r"\d+ rows of joint elbow over 1\.\d+ s", result.stderr)
    found = documents(result)
    rows = len(read_recording("r.csv").time)
    assert (found["path"], found["joint"], found["rows"]) == ("r.csv", "elbow", rows)
    assert found["duration"] == pytest.approx(1.5)
    assert found["rates"] == pytest.approx({"servo": 100, "accelerometer": 1000}, rel=0.02)
    assert found["losses"] == {"lost": 0, "late": 0, "broken": 0, "silent": 0}


def test_record_without_the_device(robot: Path) -> None:
    """A missing port: status 2, and the error's own line."""
    robot.write_text(HARDWARE)
    result = call("record", "--config", robot, "--duration", "1", "-o", "r.csv")
    assert result.exit_code == 2
    assert "no-such-port" in result.stderr.splitlines()[-1]
    assert "Traceback" not in result.stderr


def test_score_json(recording: Path) -> None:
    """The keys are those of the interface; the recording's head gives joint and oscillator."""
    found = documents(call("score", recording, "--json"))
    assert list(found) == ["joint", "level", "windows"]
    assert (found["joint"], found["level"]) == ("elbow", 4.5)
    keys = ["time", "duration", "score", "impact", "play", "play_low", "play_high"]
    keys += ["severity", "severity_low", "severity_high", "quality"]
    assert len(found["windows"]) > 5
    assert all(list(window) == keys for window in found["windows"])
    assert all(0 <= window["time"] < 4 for window in found["windows"])
    assert {window["duration"] for window in found["windows"]} == {0.25}


def test_settings_by_rank(recording: Path) -> None:
    """An option beats the configuration, which beats the default; impact means above that level."""
    config = ["--config", str(recording.parent / "robot.toml")]
    assert documents(call("score", recording, *config, "--json"))["level"] == 5.5
    high = documents(call("score", recording, *config, "--level", "1e6", "--json"))
    assert high["level"] == 1e6
    assert not any(window["impact"] for window in high["windows"])


def test_score_for_people(recording: Path) -> None:
    """A line of summary, a row for each window, and the play over all of them: 80 µm on 10 mm are 27.5', told to a
    quarter by one who knows nothing of the teeth's stiffness."""
    windows = documents(call("score", recording, "--json"))["windows"]
    lines = call("score", recording).stdout.splitlines()
    impacts = sum(window["impact"] for window in windows)
    assert lines[0] == f"joint elbow: {len(windows)} windows, {impacts} with impact (f_res 58 Hz, level 4.5)"
    assert len(lines) == 4 + len(windows)
    play = re.fullmatch(r"play: ([\d.]+)', ([\d.]+)° \(95 %: ([\d.]+) to ([\d.]+)\).*", lines[-1])
    assert play
    assert float(play[1]) == pytest.approx(27.5, rel=0.25)
    assert float(play[3]) <= math.degrees(80e-6 / 0.01) <= float(play[4])


@pytest.mark.parametrize(("unit", "is_doubted"), [("", True), ('# command_unit = "deg"\n', False)])
def test_score_doubts_degrees(unit: str, is_doubted: bool, tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """A command that goes to 40 without a unit is scored as rad, and this is said with the line to write."""
    rows = "".join(f"{t / 200},{40 * math.sin(t / 20):.3f},{t % 3 / 100}\n" for t in range(400))
    path = tmp_path / "turned.csv"
    path.write_text(f"{unit}time,command,accel\n{rows}")
    assert call("score", path).exit_code == 0
    told = 'command goes to 40 and is taken as rad; if it is degrees, write # command_unit = "deg" at the top'
    assert (told in caplog.text) == is_doubted


GOOD_ROWS = "time,command,accel\n" + "".join(f"{t / 200},0,0\n" for t in range(90))


@pytest.mark.parametrize(
    ("content", "arguments", "words"),
    [
        ("", [], ["x.csv"]),
        ("time,command,accel\n", [], ["x.csv", "no rows"]),
        ("time,command,accel\n0,0,0\n", [], ["x.csv: found 1 commands", "at least 3"]),
        ("time,command,accel\n" + "".join(f"{t * 5},0,0\n" for t in range(90)), [], ["x.csv: ", 'time_unit = "ms"']),
        ("# f_res_hz = 5000\n" + GOOD_ROWS, [], ["x.csv: f_res_hz is 5000; expected less than half of the rate"]),
        ("time,command,accel\n" + "".join(f"{10**15 + t / 200!r},0,0\n" for t in range(90)), [], ["time 1e+15"]),
        (GOOD_ROWS + "0.45,inf,0\n0.455,0,0\n", [], ["x.csv: line 92: found 'inf' in the column 'command'"]),
        ("time,command\n0,0\n1,0\n2,0\n3,0\n", [], ["'accel'", "command"]),
        ("time,accel\n0,0\n1,0\n2,0\n3,0\n", [], ["'command'"]),
        ("time,command,accel\n0,0,0\n2,0,0\n1,0,0\n", [], ["order"]),
        ("# f_res_hz = \"x\"\ntime,command,accel\n0,0,0\n", [], ["f_res_hz", "number"]),
        ("time,command,accel\n0,0,0\n", ["--column", "speed"], ["speed", "accel"]),
        ("time,command,accel\n" + "".join(f"{t / 10},0,0\n" for t in range(90)), [], ["f_res_hz is 58", "faster"]),
    ],
)  # fmt: skip
def test_bad_recording_is_one_line(tmp_path: Path, content: str, arguments: list[str], words: list[str]) -> None:
    """Whatever is wrong with a recording: status 2 and one line that says what."""
    (tmp_path / "x.csv").write_text(content)
    assert is_one_line(call("score", tmp_path / "x.csv", *arguments, "--json"), *words)


def test_score_of_the_missing_file(tmp_path: Path) -> None:
    """No such file: its name and the likely cause."""
    assert is_one_line(call("score", tmp_path / "none.csv"), "none.csv", "No such file")


def test_doctor_on_the_simulated_robot(robot: Path) -> None:
    """Everything is good there: status 0, each check with value and allowed range."""
    result = call("doctor", "--config", robot, "--json")
    assert result.exit_code == 0, result.stdout
    found = documents(result)
    by_name = {(check["subject"], check["check"]): check for check in found["checks"]}
    assert found["ok"]
    assert by_name["elbow", "poll rate"]["value"] == pytest.approx(100, rel=0.02)
    assert by_name["tip", "sample rate"]["value"] == pytest.approx(1000, rel=0.02)
    assert by_name["tip", "sample rate"]["allowed"] == "950 to 1050"
    assert 0.06 < by_name["tip", "noise"]["value"] < 0.15  # 0.1 by the driver's default
    assert by_name["system", "numpy"]["ok"]
    assert not Path("history.db").exists()


def test_doctor_without_devices(robot: Path) -> None:
    """Missing ports are bad checks with their cause, and status 1; all else is still looked at."""
    robot.write_text(HARDWARE)
    result = call("doctor", "--config", robot)
    assert result.exit_code == 1
    bad = [line for line in result.stdout.splitlines() if line.startswith("BAD: ")]
    assert any("no-such-port-0" in line for line in bad)
    assert any("no-such-port-1" in line for line in bad)
    assert "free space" in result.stdout


def test_latency_timer_of_an_adapter(robot: Path) -> None:
    """16 ms is bad, 1 ms is good, a port without such a timer is no matter."""
    robot.write_text(HARDWARE.replace("no-such-port-0", "/dev/ttyUSB0").replace("no-such-port-1", "/dev/ttyACM0"))
    config, timer = configuration.load(robot), robot.parent / "ttyUSB0" / "latency_timer"
    timer.parent.mkdir()
    for milliseconds, ok in (("16\n", False), ("1\n", True)):
        timer.write_text(milliseconds)
        (check,) = check_adapters(config, robot.parent)
        assert (check.subject, check.value, check.ok) == ("/dev/ttyUSB0", float(milliseconds), ok)
        assert bool(check.cause) is not ok


def bad_disk(config: Path) -> dict[str, str]:
    """The bad checks of the disk and their causes."""
    return {check.check: check.cause for check in check_disk(configuration.load(config)) if not check.ok}


def test_disk_and_database(robot: Path) -> None:
    """A good database tells how fast it grows; trying to write it leaves nothing behind; names of checks are fixed."""
    fill(Path("history.db"), 100)
    before = Path("history.db").read_bytes()
    checks = list(check_disk(configuration.load(robot)))
    assert [check.check for check in checks] == ["database", "free space", "room"]
    assert all(check.ok for check in checks)
    assert Path("history.db").read_bytes() == before
    assert {path.name.partition("-")[0] for path in Path().iterdir()} <= {"history.db", "history.db.lock", "robot.toml"}


def test_database_of_something_else(robot: Path) -> None:
    """A file that is no database is a bad check, not the end of the doctor."""
    Path("history.db").write_bytes(b"\xff, which is no database at all, but long enough to look like one" * 99)
    assert "not a database" in bad_disk(robot)["database"]


def test_damaged_database_of_the_doctor(robot: Path) -> None:
    """Half a database is a bad check and status 1; all other checks are still made."""
    fill(Path("history.db"))
    Path("history.db").write_bytes(Path("history.db").read_bytes()[:8192] + b"\x5a" * 50_000)
    result = call("doctor", "--config", robot, "--json")
    assert result.exit_code == 1
    checks = {check["check"]: check for check in documents(result)["checks"]}
    assert not checks["database"]["ok"]
    assert "malformed" in checks["database"]["cause"]
    assert checks["numpy"]["ok"]


def test_database_that_another_program_changed(robot: Path) -> None:
    """A database as it was written is sound; one that lacks a view and has lost a column is told, with their names."""
    fill(Path("history.db"))
    assert [(c.check, c.value, c.ok) for c in check_history(configuration.load(robot))] == [
        ("pages", "sound", True),
        ("tables", "as written", True),
    ]
    with closing(sqlite3.connect("history.db")) as db:
        db.executescript("DROP VIEW devices; ALTER TABLE device RENAME COLUMN broken TO spoilt;")
    pages, tables = check_history(configuration.load(robot))
    assert pages.ok
    assert not tables.ok
    assert "device.broken, devices.broken, devices.late" in tables.cause


@pytest.mark.parametrize("filled", [True, False])
def test_full_disk_of_the_doctor(robot: Path, filled: bool) -> None:
    """Where no more can be written, with a database or before there is one, the doctor has tried and says so."""
    if filled:
        fill(Path("history.db"))
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, limits[1]))
    try:
        found = bad_disk(robot)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert "the disk is full" in found["database"]


def test_room_is_never_negative(robot: Path) -> None:
    """A disk that cannot even hold the windows has 0 days of room, and the cause tells the growth."""
    robot.write_text(SIMULATED.replace("[store]", "[store]\nkeep_windows_mb = 1e12"))
    room = next(check for check in check_disk(configuration.load(robot)) if check.check == "room")
    assert (room.value, room.ok) == (0, False)
    assert "8.6 MB a day" in room.cause


def test_clock_that_steps() -> None:
    """Wall and monotonic clock that move apart during the pass are bad."""
    offset = clock_offset()
    assert all(check.ok for check in check_clock(offset, virtual=True))
    assert [check.check for check in check_clock(offset - 1.0, virtual=True) if not check.ok] == [
        "clock step during the pass"
    ]


def test_ranges() -> None:
    """Bounds belong to the range, NaN never does, one bound may be missing."""
    assert within("s", "c", 2.0, "", 1.0, 2.0, "why").ok
    assert within("s", "c", 2.0, "", None, 2.0, "why").allowed == "at most 2"
    bad = within("s", "c", float("nan"), "", 0.0, None, "why")
    assert (bad.ok, bad.allowed, bad.cause) == (False, "at least 0", "why")


def test_recording_of_a_recording(recording: Path, robot: Path) -> None:
    """Two devices behind one port are both measured: what was replayed and recorded again is the same."""
    text = SIMULATED.replace('"simulated"', '"replay"').replace("[simulated]", "[replay]").replace("play_m = 8e-5", "")
    robot.write_text(text.replace('driver = "replay"', f'driver = "replay"\nport = "{recording}"'))
    result = call("record", "--config", robot, "--duration", "2", "-o", "again.csv")
    assert result.exit_code == 0, result.stderr
    first, again = read_recording(recording), read_recording("again.csv")
    for column in ("command", "accel"):
        times, values = again.signal(column)
        expected = first.signal(column)[1][: len(values)]
        assert len(times) == pytest.approx(2000 if column == "accel" else 200, abs=1)
        assert values == pytest.approx(expected, abs=1e-12)
