"""Recording while samples arrive: in time order, on the disk at once, readable after a kill."""

from __future__ import annotations

import os
import resource
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from lostmotion.drivers.base import AccelBlock, ServoSample
from lostmotion.drivers.errors import RecordingError
from lostmotion.drivers.recorder import Recorder
from lostmotion.drivers.recording import read_recording


def block(first: int, last: int) -> AccelBlock:
    """An accelerometer's samples number first to last - 1, one a millisecond from 100 s on."""
    ticks = np.arange(first, last)
    return AccelBlock(100 + ticks / 1000, ticks.astype(float))


def servo(*ticks: int) -> list[ServoSample]:
    """Samples of a joint at these milliseconds."""
    return [ServoSample("elbow", 100 + tick / 1000, tick / 10, tick / 20, temperature=40.0) for tick in ticks]


def test_sources_are_joined_in_time_order(tmp_path: Path) -> None:
    """Blocks that arrive one after another become rows in time order from the origin, none lost."""
    path = tmp_path / "rec.csv"
    with Recorder(path, {"joint": "elbow"}, origin=100.0) as recorder:
        recorder.add_accel(block(0, 50))
        recorder.add_servo(servo(0, 10, 20, 30))
        recorder.add_servo([])
        recorder.add_accel(block(50, 70))
        recorder.add_servo(servo(40, 50, 60))
    recording = read_recording(path)
    times, values = recording.signal("accel")
    assert values.tolist() == list(range(70))
    np.testing.assert_array_equal(times, np.round(np.arange(70) / 1000, 9))
    assert recording.signal("command")[0].tolist() == [0.0, 0.01, 0.02, 0.03, 0.04, 0.05, 0.06]
    assert recording.signal("temperature")[1].tolist() == [40.0] * 7
    assert (recorder.rows, recorder.late) == (70, 0)
    assert recording.metadata == {"joint": "elbow"}


def test_silent_source_holds_nothing_back(tmp_path: Path) -> None:
    """When the servo says nothing, rows wait a second and no longer; what then comes too late is counted."""
    path = tmp_path / "rec.csv"
    recorder = Recorder(path, {}, origin=100.0)
    recorder.add_accel(block(0, 3000))
    assert read_recording(path).time[-1] == pytest.approx(2.0, abs=2e-3)
    recorder.add_servo(servo(500, 2500))
    recorder.close()
    recorder.close()
    recording = read_recording(path)
    assert recorder.late == 1
    assert recording.signal("command")[0].tolist() == [2.5]
    assert len(recording.time) == 3000


KILLED = """
import sys, time
from tests.drivers.test_recorder import block, servo
from lostmotion.drivers.recorder import Recorder
recorder = Recorder(sys.argv[1], {}, origin=100.0)
for first in range(0, 10**9, 50):
    recorder.add_servo(servo(*range(first, first + 50, 10)))
    recorder.add_accel(block(first, first + 50))
    print(first, flush=True)
"""


def test_killed_recorder_leaves_a_recording(tmp_path: Path) -> None:
    """After SIGKILL in the middle of writing, every row that was due is there, and at most half a line more."""
    path = tmp_path / "rec.csv"
    process = subprocess.Popen([sys.executable, "-c", KILLED, path], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    told = [int(process.stdout.readline()) for _ in range(30)]
    os.kill(process.pid, signal.SIGKILL)
    process.communicate()
    recording = read_recording(path)
    values = recording.signal("accel")[1]
    assert values[-1] >= told[-1]
    assert values[:-1].tolist() == list(range(len(values) - 1))
    assert recording.truncated in (0, 1)


@contextmanager
def room_for(size: int) -> Iterator[None]:
    """No file can grow beyond so many bytes, as if the disk were full then."""
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, limits[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)


def feed(recorder: Recorder, until: int) -> None:
    """Both devices' samples of so many milliseconds, in readings of 50 ms."""
    for first in range(0, until, 50):
        recorder.add_servo(servo(*range(first, first + 50, 10)))
        recorder.add_accel(block(first, first + 50))


def test_disk_that_fills_up_leaves_what_fitted(tmp_path: Path) -> None:
    """The error comes with the first rows that do not fit; all before are there, whole, and none after."""
    path = tmp_path / "rec.csv"
    recorder = Recorder(path, {"joint": "elbow"}, origin=100.0)
    with room_for(10_000), pytest.raises(RecordingError, match=r"rec\.csv: cannot be written: File too large"):
        feed(recorder, 10_000)
    recorder.close()
    recording = read_recording(path)
    assert recording.truncated == 0
    assert recorder.rows == len(recording.time) > 100
    assert recording.signal("accel")[1].tolist() == list(range(recorder.rows))
    assert path.stat().st_size > 8_000


def test_no_row_no_file(tmp_path: Path) -> None:
    """Where not even the head fits, or no sample came, no file is left."""
    with room_for(20), pytest.raises(RecordingError, match="File too large"):
        Recorder(tmp_path / "rec.csv", {"joint": "elbow"})
    Recorder(tmp_path / "rec.csv", {"joint": "elbow"}).close()
    assert list(tmp_path.iterdir()) == []


def test_an_earlier_recording_stays_until_something_is_measured(tmp_path: Path) -> None:
    """Without a row the file that was there keeps its bytes; the first row takes its place, however long it was."""
    path = tmp_path / "rec.csv"
    path.write_text(earlier := "time,accel\n" + "0.0,1.0\n" * 500)
    with Recorder(path, {"joint": "elbow"}, origin=100.0):
        pass
    assert path.read_text() == earlier
    with Recorder(path, {"joint": "elbow"}, origin=100.0) as recorder:
        recorder.add_accel(block(0, 5))
    assert read_recording(path).signal("accel")[1].tolist() == list(range(5))
    assert len(path.read_text()) < 200


def test_full_disk_and_missing_folder(tmp_path: Path) -> None:
    """A file that cannot be written is told in one line."""
    with pytest.raises(RecordingError, match="cannot be written: No such file"):
        Recorder(tmp_path / "none" / "rec.csv", {})
    with pytest.raises(RecordingError, match="cannot be written: No space left"):
        Recorder("/dev/full", {})
