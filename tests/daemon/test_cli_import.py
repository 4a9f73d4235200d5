"""Recordings of other programs on the command line: imported, or given where a recording is expected."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from lostmotion.drivers.recording import read_recording
from tests.daemon.cli_world import PROGRAM, call, is_one_line

REPLAY = """
[robot]
name = "arm1"
[store]
path = "history.db"
[replay]
speed = "max"
[[accelerometer]]
name = "tip"
driver = "replay"
port = "FILE"
rate_hz = 1000
oscillator = { f_res_hz = 58.0 }
[[joint]]
name = "elbow"
driver = "replay"
port = "FILE"
accelerometer = "tip"
"""
ELBOW = "/controller_state/reference/elbow/positions"


@pytest.fixture(scope="module")
def own(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A worn joint's recording."""
    path = tmp_path_factory.mktemp("own") / "worn.csv"
    assert call("simulate", "play", "-o", path, "--duration", "3", "--noise", "0.1").exit_code == 0
    return path


@pytest.fixture(scope="module")
def foreign(own: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same as PlotJuggler writes it, beside a second joint, in degrees and g."""
    path = tmp_path_factory.mktemp("foreign") / "worn.csv"
    recording = read_recording(own)
    frame = pd.DataFrame({"__time": recording.time})
    frame[ELBOW] = np.degrees(recording.columns["command"])
    frame["/controller_state/reference/wrist/positions"] = 0.5 * frame[ELBOW]
    frame["/imu/linear_acceleration/x"] = recording.columns["accel"] / 9.80665
    frame.to_csv(path, index=False)
    return path


def scores(path: str | Path) -> list[float]:
    """Of the windows of a recording."""
    result = call("score", path, "--f-res-hz", "58", "--json")
    assert result.exit_code == 0, result.stderr
    return [window["score"] for window in json.loads(result.stdout)["windows"]]


def test_options_behind_a_hash_are_taken_by_import_too(tmp_path: Path) -> None:
    """As an error message writes them; an option of its own has precedence."""
    (tmp_path / "run.csv").write_text("goal,angle\n" + "0.1,0.2\n0.3,0.4\n" * 20)
    assert "FILE#rate-hz=100" in call("import", tmp_path / "run.csv").stderr
    for options, step in ([], 0.02), (["--rate-hz", "10"], 0.1):
        assert call("import", f"{tmp_path / 'run.csv'}#rate-hz=50", "-o", tmp_path / "x.csv", *options).exit_code == 0
        assert read_recording(tmp_path / "x.csv").time[1] == pytest.approx(step)


@pytest.mark.slow
def test_import_makes_the_same_recording(own: Path, foreign: Path, tmp_path: Path) -> None:
    """What is mapped comes out in SI, with what it was made of; the scores are those of the original."""
    result = call(
        "import", foreign, "-o", tmp_path / "rec.csv", "--joint", "elbow", "--map", f"command={ELBOW}:deg",
        "--map", "accel=linear_acceleration/x:g", "--json",
    )  # fmt: skip
    assert result.exit_code == 0, result.stderr
    told = json.loads(result.stdout)
    assert (told["format"], told["joint"], told["rows"]) == ("PlotJuggler CSV", "elbow", 3000)
    assert [(one["column"], one["unit"], one["si"]) for one in told["columns"]] == [
        ("command", "deg", "rad"),
        ("accel", "g", "m/s^2"),
    ]
    assert f"command = {ELBOW}  (deg, now rad; given)" in result.stderr
    back, true = read_recording(tmp_path / "rec.csv"), read_recording(own)
    assert back.metadata["imported"]["accel"] == "/imu/linear_acceleration/x"
    np.testing.assert_allclose(back.columns["accel"], true.columns["accel"], rtol=1e-9)
    np.testing.assert_allclose(scores(tmp_path / "rec.csv"), scores(own), rtol=1e-3)


@pytest.mark.slow
def test_a_foreign_file_stands_where_a_recording_does(own: Path, foreign: Path, tmp_path: Path) -> None:
    """score and the lab read it at once; stdout stays one document, and stderr says what was taken for what."""
    said = f"{foreign}#joint=elbow,command={ELBOW}:deg,accel=linear_acceleration/x:g"
    np.testing.assert_allclose(scores(said), scores(own), rtol=1e-3)
    result = subprocess.run(
        [*PROGRAM, "lab", "compare", "play", said, "--json"], capture_output=True, text=True, check=True, cwd=tmp_path
    )
    assert "accel" in json.loads(result.stdout)["columns"]
    assert f"command = {ELBOW}  (deg, now rad; given)" in result.stderr
    named = call("score", foreign, "--joint", "elbow", "--json")
    assert json.loads(named.stdout)["joint"] == "elbow"
    assert is_one_line(call("score", foreign), "found 2 joints, expected one", "#joint=NAME")


def test_a_service_replays_a_foreign_file(foreign: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As port of the driver replay: the windows of three seconds are in the database."""
    port = f"{foreign}#joint=elbow,command={ELBOW}:deg,accel=linear_acceleration/x:g"
    monkeypatch.chdir(tmp_path)
    Path("robot.toml").write_text(REPLAY.replace("FILE", port))
    result = call("run", "--config", "robot.toml")
    assert result.exit_code == 0, result.stderr
    history = call("history", "elbow", "--config", "robot.toml", "--json")
    assert len(json.loads(history.stdout)["scores"]) == len(scores(port))


def test_looking_writes_nothing(foreign: Path, tmp_path: Path) -> None:
    """Without -o the series are listed, and what would be taken, or why that is not clear."""
    result = call("import", foreign)
    assert result.exit_code == 0
    assert f"  {ELBOW}\n" in result.stdout
    assert "choose with --joint NAME" in result.stderr
    told = json.loads(call("import", foreign, "--joint", "wrist", "--json").stdout)
    assert len(told["series"]) == 4
    assert told["columns"][0]["series"] == "/controller_state/reference/wrist/positions"
    assert list(tmp_path.iterdir()) == []


def test_wrong_calls_are_one_line(foreign: Path, tmp_path: Path) -> None:
    """A column that there is none of, a series that is not there, a file that is not there."""
    target = tmp_path / "rec.csv"
    assert is_one_line(call("import", foreign, "-o", target, "--map", "speed=x"), "--map: found 'speed=x'")
    assert is_one_line(
        call("import", foreign, "-o", target, "--joint", "elbow", "--map", "accel=imu/y"), "found no series 'imu/y'"
    )
    assert is_one_line(call("import", tmp_path / "none.mcap", "-o", target), "none.mcap: cannot be read")
    assert not target.exists()
