"""Tables without times, whose rate stands above them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from lostmotion.drivers.formats.preamble import rate_above
from lostmotion.drivers.formats.text import open_text
from lostmotion.drivers.recording import read_recording
from tests.daemon.cli_world import call

SWING = np.exp(-0.2 * np.arange(1500) / 500) * 80 * np.cos(20 * np.arange(1500) / 500)
ROWS = "".join(f"{angle:.2f}\n" for angle in SWING)


@pytest.mark.parametrize(
    ("head", "name"),
    [
        ("trigger_start_deg, sample_rate, duration_sec\n90, 500, 3 \n", "sample_rate"),
        ("# fs = 500\nangle\n", "fs"),
        ("Sampling frequency: 0.5 kHz\nangle\n", "Sampling frequency"),
        ("Sample interval (ms);2\nangle\n", "Sample interval"),
        ("Delta_X\t0.002\n\nangle\n", "Delta_X"),
        ("% dt: 2e-3 s\nangle\n", "dt"),
    ],
)
def test_the_rate_above_the_rows(head: str, name: str, tmp_path: Path) -> None:
    path = tmp_path / "swing.txt"
    path.write_text(head + ROWS)
    done = call("import", path, "-o", tmp_path / "out.csv")
    assert done.exit_code == 0, done.output
    assert f"500 rows a second, by '{name}'" in done.output
    table = read_recording(tmp_path / "out.csv")
    assert table.time[-1] == pytest.approx(1499 / 500)
    assert table.columns["position"][-1] == pytest.approx(np.deg2rad(SWING[-1]), abs=1e-4)


def test_what_is_given_counts(tmp_path: Path) -> None:
    """A rate that is given on the command line, and times in the file, are taken instead."""
    path = tmp_path / "swing.txt"
    path.write_text("fs: 500\nangle\n" + ROWS)
    done = call("import", f"{path}#rate-hz=100", "-o", tmp_path / "out.csv")
    assert "100 rows a second, as given" in done.output
    path.write_text("fs: 500\ntime,angle\n" + "".join(f"{k / 250:.3f},{angle:.2f}\n" for k, angle in enumerate(SWING)))
    assert "time: time [s]" in call("import", path, "-o", tmp_path / "out.csv").output


@pytest.mark.parametrize(
    "line",
    [
        "rate: 500",
        "fs: ",
        "dt: 0",
        "sample rate: -5 Hz",
        "duration: 3 s",
        "sample rate: 500 rpm",
        "sample time: 10:31",
        "data rate: 1.0.3",
        "dt: 1e400",
        "fs: 1e400",
        "sampl" + 50_000 * "_" + ": 5",
        "",
    ],
)
def test_what_is_no_rate(line: str) -> None:
    assert rate_above([f"{line}\n", "angle\n"]) == ("", 0.0)


def test_numbers_are_no_name(tmp_path: Path) -> None:
    """Settings that stand above the rows do not name the only column."""
    path = tmp_path / "swing.txt"
    path.write_text("start_deg, trials, length\n90, 7, 3 \n" + ROWS)
    assert [one.name for one in open_text(path).series] == ["column1"]
