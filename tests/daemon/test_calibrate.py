"""The `calibrate` commands on recordings whose truth is known."""

from __future__ import annotations

import json
import math
import tomllib
from pathlib import Path

import numpy as np
import pytest

from lostmotion.daemon.commands import calibrate_healthy
from lostmotion.drivers.recording import Recording, merge, write_recording
from tests.daemon.cli_world import SIMULATED, call, is_one_line
from tests.detector.recordings import moved
from tests.detector.test_taps import tapped


@pytest.fixture
def taps(tmp_path: Path) -> Path:
    """Five taps on a bar of 58 Hz with a damping of 0.012, and mains hum."""
    time, accel = tapped(np.random.default_rng(7800), 1000.0, 58.0, 0.012, 0.1)
    write_recording(Recording(time, {"accel": accel}), tmp_path / "taps.csv")
    return tmp_path / "taps.csv"


def test_tap(taps: Path) -> None:
    """Resonance and damping with intervals, and lines that are the oscillator of a configuration."""
    document = json.loads(call("calibrate", "tap", taps, "--json").stdout)
    assert document["f_res_hz"]["value"] == pytest.approx(58.0, rel=0.005)
    assert document["f_res_hz"]["low"] < 58.0 < document["f_res_hz"]["high"]
    assert document["zeta"]["value"] == pytest.approx(0.012, rel=0.1)
    assert (document["taps"], document["mains_hz"], document["warnings"]) == (5, 50.0, [])
    assert tomllib.loads(document["toml"])["oscillator"]["f_res_hz"] == pytest.approx(58.0, rel=0.005)
    assert "5 taps; mains hum of 50 Hz" in call("calibrate", "tap", taps).stdout


def test_lines_go_to_a_new_file_only(taps: Path) -> None:
    """-o writes the lines once; a file that is there is never touched."""
    target = taps.with_name("oscillator.toml")
    assert call("calibrate", "tap", taps, "-o", target).exit_code == 0
    written = target.read_text()
    assert tomllib.loads(written)["oscillator"]["zeta"] == pytest.approx(0.012, rel=0.1)
    assert is_one_line(call("calibrate", "tap", taps, "-o", target), "found a file", "nothing is merged")
    assert target.read_text() == written


def test_tap_says_what_is_wrong(taps: Path) -> None:
    """No tap, no such column: one line each."""
    time = np.arange(0, 4, 1e-3)
    silent = taps.with_name("silent.csv")
    write_recording(Recording(time, {"accel": np.random.default_rng(1).normal(size=time.size)}), silent)
    assert is_one_line(call("calibrate", "tap", silent), "silent.csv", "was the bar tapped")
    assert is_one_line(call("calibrate", "tap", taps, "--column", "sound"), "--column", "accel")


def written(folder: Path, name: str, seconds: float, impact: float, seed: int) -> Path:
    """A recording of a joint in motion, with rings of that amplitude after its reversals."""
    servo, command, time, accel = moved(np.random.default_rng(seed), seconds, 200.0, "white", impact)
    times, columns = merge((servo, {"command": command}), (time, {"accel": accel}))
    write_recording(Recording(times, columns, {"f_res_hz": 58.0}), folder / name)
    return folder / name


@pytest.mark.slow
def test_healthy(tmp_path: Path) -> None:
    """The noise is found, the lines are a valid [detector] table, and a larger play needs a brisker motion."""
    healthy = written(tmp_path, "healthy.csv", 60, 0.0, 7810)
    document = json.loads(call("calibrate", "healthy", healthy, "--json").stdout)
    assert document["windows"] >= 50
    assert document["settings"]["noise_ms2"] == pytest.approx(0.2, rel=0.03)
    assert document["found"]["ringdown"] > document["found_before"] == pytest.approx(0.6, abs=0.02)
    needed = [row["acceleration"] for row in document["needed"]]
    assert needed[-1] > needed[-2]
    assert document["settings"]["gentle"] == pytest.approx(2 * needed[1], rel=0.01)
    robot = SIMULATED.replace("level = 5.5", document["toml"])
    (tmp_path / "robot.toml").write_text(robot)
    assert call("config", "check", tmp_path / "robot.toml").exit_code == 0
    words = call("calibrate", "healthy", healthy, "--worn", written(tmp_path, "worn.csv", 20, 1.0, 7811)).stdout
    assert "worn windows, share detected at 10 % false alarms" in words


@pytest.mark.slow
def test_healthy_with_impacts(tmp_path: Path) -> None:
    """A worn joint that is called healthy is refused in a line."""
    worn = written(tmp_path, "worn.csv", 60, 40.0, 7812)
    assert is_one_line(call("calibrate", "healthy", worn), "found impacts in the healthy windows")


@pytest.mark.slow
def test_healthy_where_no_ring_is_large_enough(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where no motion makes a play detectable, that is said, and the lines are valid without ``gentle``."""
    monkeypatch.setattr(calibrate_healthy, "least_amplitude", lambda *_: math.inf)
    result = call("calibrate", "healthy", written(tmp_path, "healthy.csv", 60, 0.0, 7810), "--json")
    assert "no motion makes a play detectable" in result.stderr
    document = json.loads(result.stdout)
    assert document["needed"][1]["acceleration"] is None
    (tmp_path / "robot.toml").write_text(SIMULATED.replace("level = 5.5", document["toml"]))
    assert "gentle" not in document["toml"]
    assert call("config", "check", tmp_path / "robot.toml").exit_code == 0


@pytest.mark.slow
def test_level_by_promise_and_by_labels(tmp_path: Path) -> None:
    """A promise of 5 % from healthy windows; eq. 9 with worn ones; too few windows are refused with what is needed."""
    healthy = written(tmp_path, "healthy.csv", 75, 0.0, 7820)
    worn = written(tmp_path, "worn.csv", 20, 1.0, 7821)
    promised = json.loads(
        call("calibrate", "level", healthy, "--statistic", "ringdown", "--false-alarm", "0.05", "--json").stdout
    )
    assert promised["false_positive"] / promised["healthy"] == pytest.approx(0.05, abs=0.01)
    assert 1.0 < promised["level"] < 2.5
    labelled = json.loads(
        call(
            "calibrate", "level", healthy, "--worn", worn, "--statistic", "ringdown", "--criterion", "youden", "--json"
        ).stdout
    )
    assert labelled["false_negative"] <= 1
    assert labelled["false_positive"] <= 3
    refused = call("calibrate", "level", healthy)
    assert is_one_line(
        refused, "sound healthy windows, expected at least 1599", " of this motion) to promise", "--false-alarm"
    )
    assert is_one_line(call("calibrate", "level", healthy, "--false-alarm", "nan"), "found nan, expected a number")


def test_windows_say_what_is_wrong(tmp_path: Path) -> None:
    """A recording at rest has no windows."""
    time = np.arange(0, 5, 0.01)
    rest = tmp_path / "rest.csv"
    write_recording(Recording(time, {"command": 0 * time, "accel": np.sin(time)}), rest)
    assert is_one_line(call("calibrate", "healthy", rest, "--f-res-hz", "20"), "rest.csv", "no reversal")
