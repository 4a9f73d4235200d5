"""What is said of recordings as they are read."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from lostmotion.daemon.cli import cli
from lostmotion.drivers.recording import Recording, write_recording
from lostmotion.lab.commands.reading import Files, used
from lostmotion.lab.errors import ExperimentError


def written(folder: Path, name: str, *, rate_hz: float = 100.0) -> Path:
    """A joint that a voltage swings, without a torque."""
    time = np.arange(400) / rate_hz
    columns = {"voltage": np.sin(2 * time * rate_hz / 100), "position": np.sin(2 * time * rate_hz / 100 + 1.0)}
    write_recording(Recording(time, columns, name=name), folder / name)
    return folder / name


def test_what_is_the_same_of_several_recordings_is_said_once(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """One line with the first one's name and the number of the others; what is said of one alone has its own."""
    paths = [written(tmp_path, f"{at}.csv") for at in range(3)]
    paths.append(written(tmp_path, "slow.csv", rate_hz=1.0))
    with used("joint", Files(tuple(paths))):
        pass
    of_voltage = [one for one in caplog.messages if "no torque was found" in one]
    assert len(of_voltage) == 1
    assert f"{paths[0]} and 3 more: no torque was found; the motor's voltage is taken for it" in of_voltage[0]
    assert sum("are they in ms" in one for one in caplog.messages) == 1
    assert any(one.startswith(f"{paths[3]}: found a sample every 1 s") for one in caplog.messages)


def test_warnings_before_a_refusal_are_printed(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """What was said of the first recording is not lost where the second one is refused."""
    paths = [written(tmp_path, "whole.csv"), tmp_path / "short.csv"]
    paths[1].write_text("time,voltage,position\n0,1,2\n0.01,1,2\n0.02,2,3\n")
    with pytest.raises(ExperimentError, match="short"), used("joint", Files(tuple(paths))):
        pass
    assert any("no torque was found" in one for one in caplog.messages)


def test_a_recording_in_the_place_of_the_model(tmp_path: Path) -> None:
    """Who types only a recording reads which models there are; without one it is the recordings that are missing."""
    path = str(written(tmp_path, "arm.csv"))
    told = CliRunner().invoke(cli, ["lab", "explain", path]).stderr
    assert f"lab explain joint {path}; the bases are joint (what a torque" in told
    assert "found no 'REC...'" in CliRunner().invoke(cli, ["lab", "explain", "joint"]).stderr
