"""The `calibrate` commands on recordings whose truth is known."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path

import numpy as np
import pytest

from lostmotion.drivers.recording import Recording, write_recording
from tests.daemon.cli_world import call, is_one_line
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
