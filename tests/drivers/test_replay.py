"""A recording as a robot: every sample, in time order, at the speed asked for."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import time
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from lostmotion.drivers.base import AccelBlock, OscillatorOptions, ServoSample
from lostmotion.drivers.errors import EndOfData, PortError, RecordingError
from lostmotion.drivers.recording import Recording, write_recording
from lostmotion.drivers.replay import (
    ReplayAccelerometer,
    ReplayAccelerometerOptions,
    ReplayClock,
    ReplayJointOptions,
    ReplayJoints,
    ReplayOptions,
)
from tests.conftest import Measurements

EXAMPLES = Path(__file__).parent.parent.parent / "examples"
OSCILLATOR = OscillatorOptions(f_res_hz=58.0)


def robot(path: Path, *, rate_hz: float = 1000.0, column: str = "accel", poll_hz: float = 100.0, **options: Any) -> Any:
    """The clock, the joints and the accelerometer of a replay, not yet open."""
    settings = ReplayOptions(**({"speed": "max"} | options))
    clock = ReplayClock(settings)
    joint = ReplayJointOptions(name="elbow", driver="replay", port=str(path), accelerometer="tip", poll_hz=poll_hz)
    sensor = msgspec.convert(
        {
            "name": "tip",
            "driver": "replay",
            "port": str(path),
            "rate_hz": rate_hz,
            "column": column,
            "oscillator": msgspec.to_builtins(OSCILLATOR),
        },
        ReplayAccelerometerOptions,
    )
    return clock, ReplayJoints([joint], settings, clock), ReplayAccelerometer(sensor, settings, clock)


def opened(path: Path, **options: Any) -> Any:
    """The same, open."""
    clock, joints, accelerometer = robot(path, **options)
    joints.open()
    accelerometer.open()
    return clock, joints, accelerometer


def all_samples(joints: ReplayJoints) -> list[ServoSample]:
    """Everything up to the end."""
    samples: list[ServoSample] = []
    while True:
        try:
            samples += joints.read().samples
        except EndOfData:
            return samples


def all_blocks(accelerometer: ReplayAccelerometer) -> list[AccelBlock]:
    """Everything up to the end."""
    blocks = []
    while True:
        try:
            blocks.append(accelerometer.read())
        except EndOfData:
            return blocks


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """4 s: accel at 1 kHz with a gap of 1 s in it, command at 100 Hz in rows of its own, from t = 50 s on."""
    ticks = np.concatenate([np.arange(0, 2000), np.arange(3000, 4001)])
    columns = {"command": np.where(ticks % 10 == 0, ticks / 1000, np.nan), "accel": ticks * 2.0}
    write_recording(Recording(50 + ticks / 1000, columns, {"start": "2026-01-31T12:00:00Z"}), tmp_path / "rec.csv")
    return tmp_path / "rec.csv"


def test_every_sample_comes_in_time_order(path: Path) -> None:
    """As fast as possible nothing is lost, time counts from 0, and blocks are at most half a second long."""
    _, joints, accelerometer = opened(path)
    blocks = all_blocks(accelerometer)
    times = np.concatenate([block.time for block in blocks])
    np.testing.assert_allclose(times, np.concatenate([np.arange(2000), np.arange(3000, 4001)]) / 1000, atol=1e-9)
    np.testing.assert_allclose(np.concatenate([block.accel for block in blocks]), 2000 * times, atol=1e-6)
    assert max(np.ptp(block.time) for block in blocks) <= 0.5
    samples = all_samples(joints)
    assert [round(sample.time, 9) for sample in samples] == [t / 100 for t in [*range(200), *range(300, 401)]]
    assert all(sample.command == pytest.approx(sample.time) for sample in samples)
    assert np.isnan(samples[0].position)
    assert np.isnan(joints.resolution_rad)


def test_resolution_and_range_are_the_recordings(path: Path, tmp_path: Path) -> None:
    """What a recording knows of its devices holds for its command and accel, not for a force in their place."""
    times = np.arange(100) / 100
    columns = {"command": times, "accel": times, "force": times}
    known = {"resolution_rad": 0.005, "range_ms2": 157}
    write_recording(Recording(times, columns, known), tmp_path / "known.csv")
    _, joints, accelerometer = opened(tmp_path / "known.csv")
    assert (joints.resolution_rad, accelerometer.range_ms2) == (0.005, 157.0)
    _, _, force = opened(tmp_path / "known.csv", column="force")
    _, unknown, sensor = opened(path)
    assert force.range_ms2 == sensor.range_ms2 == np.inf
    assert np.isnan(unknown.resolution_rad)


@pytest.mark.parametrize("wrong", [-1, "small", True])
def test_a_resolution_that_is_none_is_told(wrong: Any, tmp_path: Path) -> None:
    """A negative resolution, or a word, is refused when the recording is opened."""
    write_recording(Recording(np.zeros(1), {"command": np.ones(1)}, {"resolution_rad": wrong}), tmp_path / "rec.csv")
    _, joints, _ = robot(tmp_path / "rec.csv")
    with pytest.raises(RecordingError, match="# resolution_rad: found"):
        joints.open()


def test_clock_follows_the_reading(path: Path) -> None:
    """Robot time stands where the reading has got to, and UTC begins where the recording says."""
    clock, _, accelerometer = opened(path)
    assert clock.utc(1.5) == datetime(2026, 1, 31, 12, 0, 1, 500000, tzinfo=UTC)
    block = accelerometer.read()
    assert block.time[-1] <= clock.now() <= 0.5
    all_blocks(accelerometer)
    assert clock.now() == pytest.approx(4.0)


def test_start_is_the_options_or_such_that_it_ends_now(path: Path, tmp_path: Path) -> None:
    """The option's start goes before the file's; without either the recording ends at this moment."""
    clock, _, _ = opened(path, start=datetime(2020, 1, 1, tzinfo=UTC))
    assert clock.utc(0).year == 2020
    write_recording(Recording(np.array([0.0, 60.0]), {"accel": np.ones(2), "command": np.ones(2)}), tmp_path / "b.csv")
    clock, _, _ = opened(tmp_path / "b.csv")
    assert abs(clock.utc(60.0) - datetime.now(UTC)) < timedelta(seconds=30)
    write_recording(Recording(np.zeros(1), {"accel": np.ones(1)}, {"start": "noon"}), tmp_path / "c.csv")
    with pytest.raises(RecordingError, match="found start = 'noon', expected a UTC time"):
        opened(tmp_path / "c.csv")


def test_speed_is_kept(path: Path) -> None:
    """At ten times real speed, 4 s take no less than 0.4 s."""
    _, _, accelerometer = opened(path, speed=10.0)
    begin = time.monotonic()
    blocks = all_blocks(accelerometer)
    assert time.monotonic() - begin >= 0.4
    assert sum(len(block.time) for block in blocks) == 3001


def test_long_gap_does_not_block(tmp_path: Path) -> None:
    """In a gap a reading at real speed comes back within about a quarter of a second, with nothing."""
    write_recording(Recording(np.array([0.0, 100.0]), {"accel": np.ones(2), "command": np.ones(2)}), tmp_path / "g.csv")
    _, _, accelerometer = opened(tmp_path / "g.csv", speed=1.0)
    assert sum(len(accelerometer.read().time) for _ in range(8)) == 1
    _, _, fast = opened(tmp_path / "g.csv")
    assert len(all_blocks(fast)) == 2


def test_fast_command_is_thinned_to_the_polls(tmp_path: Path) -> None:
    """A command recorded at 1 kHz is polled at 50 Hz, one recorded at about 100 Hz is taken as it is."""
    times = np.arange(1000) / 1000
    write_recording(Recording(times, {"command": times, "accel": times}), tmp_path / "rec.csv")
    _, joints, _ = opened(tmp_path / "rec.csv", poll_hz=50.0)
    assert [sample.time for sample in all_samples(joints)] == pytest.approx([k / 50 for k in range(50)])
    jittered = np.arange(100) / 100 + np.where(np.arange(100) % 2, 0.003, 0)
    write_recording(Recording(jittered, {"command": jittered, "accel": jittered}), tmp_path / "rec.csv")
    _, joints, _ = opened(tmp_path / "rec.csv", poll_hz=90.0)
    assert len(all_samples(joints)) == 100


def test_rate_is_checked(path: Path) -> None:
    """A recording at another rate than the configuration says is told, with both rates."""
    _, joints, accelerometer = robot(path)
    (told,) = accelerometer.identify()
    assert (told.name, told.ok) == ("tip", True)
    assert told.found.startswith("accel at 1000 Hz, 4 s, in ")
    assert [item.ok for item in joints.identify()] == [True]
    _, joints, other = robot(path, rate_hz=200.0, poll_hz=400.0)
    assert [(item.expected, item.ok) for item in joints.identify()] == [("command at 400 Hz or more", False)]
    (told,) = other.identify()
    assert (told.expected, told.ok) == ("accel at 200 Hz", False)


def test_missing_column_and_file_are_told_when_opened(path: Path, tmp_path: Path) -> None:
    """What cannot be replayed is refused before the first sample."""
    _, _, accelerometer = robot(path, column="force")
    with pytest.raises(RecordingError, match="found samples of command, accel, expected 'force'"):
        accelerometer.open()
    _, joints, _ = robot(tmp_path / "none.csv")
    with pytest.raises(RecordingError, match="cannot be read"):
        joints.open()
    with pytest.raises(PortError, match="call open first"):
        joints.read()


def test_reopened_replay_goes_on(path: Path) -> None:
    """Closing twice is allowed, and nothing is handed out twice after opening again."""
    _, _, accelerometer = opened(path)
    first = accelerometer.read()
    accelerometer.close()
    accelerometer.close()
    accelerometer.open()
    assert accelerometer.read().time[0] > first.time[-1]


def test_one_row_is_replayed(tmp_path: Path) -> None:
    """A recording of one row is one sample, then the end."""
    write_recording(Recording(np.array([7.0]), {"command": np.ones(1), "accel": np.ones(1)}), tmp_path / "one.csv")
    _, joints, accelerometer = opened(tmp_path / "one.csv")
    assert [(s.time, s.command) for s in all_samples(joints)] == [(0.0, 1.0)]
    assert [block.time.tolist() for block in all_blocks(accelerometer)] == [[0.0]]


def test_real_recording_with_force_as_the_signal(real_data: Measurements) -> None:
    """The friction damper's displacement is the command, its force the signal; all of it comes."""
    path = real_data("friction_backlash_30lb") / "1Hz_30lb_1in.csv"
    _, joints, accelerometer = opened(path, rate_hz=1024.0, column="force")
    assert [item.ok for item in accelerometer.identify()] == [True]
    assert sum(len(block.time) for block in all_blocks(accelerometer)) == 7169
    samples = all_samples(joints)
    assert len(samples) == 701
    assert max(abs(sample.command) for sample in samples) == pytest.approx(0.0254, rel=0.05)


def test_service_over_a_real_recording(real_data: Measurements, tmp_path: Path) -> None:
    """The example configuration, run as a user would: a window at each of 15 reversals of the commanded acceleration.

    The last one ends behind the recording and has no score.
    """
    shutil.copy(real_data("friction_backlash_30lb") / "1Hz_30lb_1in.csv", tmp_path / "recording.csv")
    config = EXAMPLES / "replay.toml"
    lostmotion = Path(sys.executable).parent / "lostmotion"
    subprocess.run([lostmotion, "run", "--config", config], cwd=tmp_path, check=True, capture_output=True, timeout=60)
    told = subprocess.run(
        [lostmotion, "history", "damper", "--config", config, "--json"], cwd=tmp_path, check=True, capture_output=True
    )
    scores = json.loads(told.stdout)["scores"]
    assert len(scores) == 15
    assert [row["score"] is None for row in scores] == [False] * 14 + [True]
    # Impacts ring louder on one side of the gap than on the other.
    assert np.median([row["score"] for row in scores[4:13:2]]) > 1.5 * np.median(
        [row["score"] for row in scores[5:12:2]]
    )
