"""The sketch of docs/sensors.md, compiled for the host beside an emulated ADXL345; its lines through the driver."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from lostmotion.drivers.base import OscillatorOptions
from lostmotion.drivers.csv_serial import CsvFormat, CsvSerialOptions
from lostmotion.drivers.timeline import Timeline
from tests.conftest import ROOT

SKETCH, ARDUINO = ROOT / "examples" / "sensors" / "fifo_accelerometer", Path(__file__).with_name("arduino")
COMPILER = shutil.which("g++")
pytestmark = pytest.mark.skipif(COMPILER is None, reason="no g++ on this machine")
WRAP = 2**32


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The sketch with the emulated sensor, as a program of the host."""
    target = tmp_path_factory.mktemp("sketch") / "sketch"
    assert COMPILER
    flags = ["-std=c++17", "-Wall", "-Wextra", "-Werror", f"-I{ARDUINO}", f"-I{SKETCH}"]
    subprocess.run([COMPILER, *flags, str(ARDUINO / "main.cpp"), "-o", str(target)], check=True, timeout=300)
    return target


@pytest.mark.parametrize("period_us", [1250.0, 1250 / 1.04, 1250 / 0.96])
@pytest.mark.parametrize("held_us", [0.0, 30e3, 150e3])
def test_every_reading_has_its_time_or_is_told_lost(program: Path, period_us: float, held_us: float) -> None:
    """Five seconds of a sensor that is 4 % fast or slow, while micros() wraps: times to 200 us once it has settled;
    after a hold-up as many are told lost as are missing, to one, and the driver counts these, none broken."""
    done = subprocess.run(
        [program, str(period_us), str(held_us)], capture_output=True, text=True, check=True, timeout=60
    )
    first_us = float(done.stderr.split()[0])
    lines = done.stdout.splitlines()
    rows = np.array([[int(cell) for cell in line.split(",")] for line in lines if not line.startswith("#")])
    told = sum(int(line.split()[1]) for line in lines if line.startswith("#lost"))
    number = np.unwrap(rows[:, 1], period=4096)
    assert number[0] == 0
    missing = int(np.sum(np.diff(number) - 1))
    assert (missing > 0) == (held_us > 33 * period_us)
    assert abs(told - missing) <= 1  # nobody can say whether the last one before the fetch was overwritten
    assert (told > 0) == (missing > 0)
    late = (rows[:, 0] - (first_us + number * period_us) + WRAP / 2) % WRAP - WRAP / 2
    settled = number > 800
    assert np.abs(late[settled]).max() < 200
    options = CsvSerialOptions(
        name="tip", driver="csv_serial", port="none", rate_hz=800, oscillator=OscillatorOptions(f_res_hz=58),
        time_column=0, scale=0.0383,
    )  # fmt: skip
    form = CsvFormat(options)
    form.feed(b"cut\n")
    assert form.wraps is not None
    timeline, lost, broken, values = Timeline(1 / 800, form.wraps, form.tick), 0, 0, 0
    data = done.stdout.encode()
    for start in range(0, len(data), 2000):
        readings = form.feed(data[start : start + 2000])
        assert readings.stamps is not None
        block = timeline.stamped(readings.stamps, readings.accel, start / 2000 * 0.2, readings.broken)
        lost, broken, values = lost + block.lost, broken + block.broken, values + int(np.isfinite(block.accel).sum())
    assert (broken, values) == (0, len(rows))
    assert abs(lost - missing) <= max(1, 0.06 * missing)  # the driver counts in periods of the nominal rate
