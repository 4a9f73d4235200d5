"""Recordings written for other programs, read back by their own libraries."""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

from lostmotion.drivers.errors import RecordingError
from lostmotion.drivers.formats.read import imported
from lostmotion.drivers.formats.source import Choice
from lostmotion.drivers.formats.to_mcap import write_mcap
from lostmotion.drivers.formats.to_rerun import write_rerun
from lostmotion.drivers.recording import Recording, read_recording, write_recording
from tests.daemon.cli_world import call, is_one_line

T = np.arange(120) * 0.005 - 0.1
START = datetime(2026, 1, 31, 12, 0, 0, 250000, UTC)
SERVO = np.where(np.arange(120) % 2, np.nan, np.sin(T))
RECORDING = Recording(
    T,
    {"command": SERVO + 0.1, "position": SERVO, "torque": 2 * SERVO, "accel": np.cos(T), "voltage": np.full(120, 12.0)},
    {"joint": "elbow", "start": START, "f_res_hz": 58.0},
)


def test_mcap_is_read_by_others(tmp_path: Path) -> None:
    """Foxglove's own reader finds ROS 2's messages with their definitions: stamps in UTC, numbers to the bit."""
    path = tmp_path / "x.mcap"
    assert write_mcap(RECORDING, "elbow", path) == 120 + 120 + 120
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        told = [
            (channel.topic, message.log_time, value) for _, channel, message, value in reader.iter_decoded_messages()
        ]
        assert next(iter(reader.iter_metadata())).metadata["f_res_hz"] == "58.0"
        assert reader.get_header().profile == "ros2"
    joints = [(at, value) for topic, at, value in told if topic == "/joint_states"]
    sampled = ~np.isnan(SERVO)
    assert [list(value.name) for _, value in joints] == [["elbow"]] * 60
    np.testing.assert_array_equal([value.position[0] for _, value in joints], SERVO[sampled])
    np.testing.assert_array_equal([value.effort[0] for _, value in joints], 2 * SERVO[sampled])
    begin = round(START.timestamp() * 1e6) * 1000
    np.testing.assert_allclose([at - begin for at, _ in joints], (T - T[0])[sampled] * 1e9, atol=1)
    assert joints[0][1].header.stamp.sec * 10**9 + joints[0][1].header.stamp.nanosec == joints[0][0] == begin
    imu = [value for topic, _, value in told if topic == "/imu"]
    np.testing.assert_array_equal([value.linear_acceleration.x for value in imu], np.cos(T))
    assert imu[0].orientation_covariance[0] == -1


@pytest.mark.parametrize("start", [START, None])
def test_mcap_comes_back(start: datetime | None, tmp_path: Path) -> None:
    """Exported and imported it is the same recording, also without a known start, and no axis has to be chosen."""
    path, metadata = tmp_path / "x.mcap", {"start": start} if start else {}
    write_mcap(replace(RECORDING, metadata=metadata), "elbow", path)
    back = imported(path, Choice()).recording
    assert back.metadata.get("start") == start
    assert back.metadata["joint"] == "elbow"
    for column, values in RECORDING.columns.items():
        times, found = back.signal(column)
        np.testing.assert_array_equal(found, values[~np.isnan(values)])
        np.testing.assert_allclose(times, T[~np.isnan(values)] - T[0], atol=2e-9)


def test_times_that_ros_cannot_say_are_refused(tmp_path: Path) -> None:
    """Beyond 2038, or before 1970."""
    for year in (2040, 1960):
        wrong = replace(RECORDING, metadata={"start": datetime(year, 1, 1, tzinfo=UTC)})
        with pytest.raises(RecordingError, match="expected 1970 to 2038"):
            write_mcap(wrong, "elbow", tmp_path / "x.mcap")


@pytest.mark.parametrize("start", [START, None])
def test_rerun(start: datetime | None, tmp_path: Path) -> None:
    """Rerun's own reader finds a scalar for each column, over UTC where the start is known."""
    pytest.importorskip("rerun", reason="rerun-sdk is not installed: pip install 'lostmotion[rerun]'")
    chunks = pytest.importorskip("rerun.chunk", reason="this rerun-sdk has no reader of files")
    path = tmp_path / "x.rrd"
    recording = replace(RECORDING, metadata={"start": start} if start else {})
    assert write_rerun(recording, "elbow", path) == 3 * 60 + 2 * 120
    batches = [chunk.to_record_batch() for chunk in chunks.RrdReader(path).stream().to_chunks()]
    (found,) = [each for each in batches if each.schema.metadata[b"rerun:entity_path"] == b"/elbow/position"]
    np.testing.assert_array_equal(
        [value[0] for value in found.column("Scalars:scalars").to_pylist()], SERVO[~np.isnan(SERVO)]
    )
    nanoseconds = found.column("time").cast("int64").to_numpy()
    begin = START.timestamp() - T[0] if start else 0.0
    np.testing.assert_allclose((nanoseconds - round(begin * 1e9)) * 1e-9, T[~np.isnan(SERVO)], atol=1e-6)


def test_command(tmp_path: Path) -> None:
    """The ending says the format; what cannot be written leaves nothing behind."""
    write_recording(RECORDING, tmp_path / "rec.csv")
    result = call("export", tmp_path / "rec.csv", "-o", tmp_path / "x.mcap", "--joint", "arm")
    assert result.exit_code == 0, result.stderr
    assert read_recording(tmp_path / "x.mcap").metadata["joint"] == "arm"
    known = replace(RECORDING, metadata={"f_res_hz": 40.0, "zeta": 0.02, "note": 'a "new" bar'})
    write_recording(known, tmp_path / "rec.csv")
    assert call("export", tmp_path / "rec.csv", "-o", tmp_path / "x.mcap").exit_code == 0
    assert known.metadata.items() <= read_recording(tmp_path / "x.mcap").metadata.items()
    assert is_one_line(call("export", tmp_path / "rec.csv", "-o", tmp_path / "x.txt"), "expected .mcap, or .rrd")
    assert is_one_line(call("export", tmp_path / "rec.csv", "-o", tmp_path / "no" / "x.mcap"), "cannot be written")
    assert sorted(each.name for each in tmp_path.iterdir()) == ["rec.csv", "x.mcap"]
