"""MCAP and rosbag2, written by mcap and rosbags: which topic and joint are taken, by which clock, and damage."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.writer import CompressionType
from rosbags.rosbag2 import StoragePlugin

from lostmotion.drivers.errors import RecordingError
from lostmotion.drivers.formats.choice import parse_map
from lostmotion.drivers.formats.messages import decoder_of, flat
from lostmotion.drivers.formats.read import Imported, imported
from lostmotion.drivers.formats.source import Choice
from lostmotion.drivers.recording import read_recording
from tests.drivers import bags


def read(path: Path, *terms: str, **choice: Any) -> Imported:
    """What is taken of a file, with ``--map``."""
    return imported(path, Choice(parse_map(terms), **choice))


def refused(path: Path, *terms: str, **choice: Any) -> str:
    """The one line by which a file is refused."""
    with pytest.raises(RecordingError) as caught:
        read(path, *terms, **choice)
    told = str(caught.value)
    assert "\n" not in told
    assert told.startswith(str(path))
    return told


@pytest.fixture(
    scope="module", params=["SQLITE3", "MCAP", "one file", "one database", "unindexed", "lz4", "compressed"]
)
def bag(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same messages in each storage."""
    folder = tmp_path_factory.mktemp("bag")
    match request.param:
        case "one file":
            bags.write_mcap(folder / "x.mcap")
            return folder / "x.mcap"
        case "lz4":
            bags.write_mcap(folder / "x.mcap", compression=CompressionType.LZ4)
            return folder / "x.mcap"
        case "compressed":
            bags.write_rosbag(folder / "x", StoragePlugin.SQLITE3, is_compressed=True)
            return folder / "x"
        case "unindexed":
            bags.write_unindexed(folder / "x.mcap")
            return folder / "x.mcap"
        case "one database":
            bags.write_rosbag(folder / "x", StoragePlugin.SQLITE3)
            return next((folder / "x").glob("*.db3"))
        case storage:
            bags.write_rosbag(folder / "x", StoragePlugin[storage])
            return folder / "x"


def test_a_joint_is_taken_from_its_topics(bag: Path) -> None:
    """The command is the controller's reference; times are the headers' to the ns, not those of receipt."""
    found = read(bag, "accel=/imu.linear_acceleration.x", joint="elbow")
    chosen = {one.column: one.series for one in found.columns}
    assert chosen == {
        "command": "/arm_controller/controller_state.reference.positions[elbow]",
        "position": "/joint_states.position[elbow]",
        "accel": "/imu.linear_acceleration.x",
        "torque": "/joint_states.effort[elbow]",
        "voltage": "/voltage.data",
    }
    recording = found.recording
    times, position = recording.signal("position")
    np.testing.assert_allclose(times, np.arange(bags.COUNT) * bags.JOINT_S, atol=1e-9)
    np.testing.assert_allclose(position, bags.angle(times), atol=1e-9)
    np.testing.assert_allclose(recording.signal("command")[1], position + 0.01)
    np.testing.assert_allclose(recording.signal("torque")[1], 2 * position)
    assert recording.signal("accel")[0].size == bags.COUNT * 5
    np.testing.assert_allclose(recording.signal("voltage")[0], times, atol=1e-9)
    assert "/voltage without stamps: times of receipt, -3 ms as the other topics" in found.notes
    start = datetime.fromtimestamp(bags.START_NS // 10**9, UTC) + timedelta(microseconds=123457)
    assert recording.metadata["start"] == start
    assert found.clock == "stamps of the headers"
    assert "accel: not taken" in str(read(bag, joint="wrist").notes)


@pytest.mark.parametrize("name", ["x.bag", "x.mcap"])
def test_messages_of_ros_1(name: str, tmp_path: Path) -> None:
    """A bag, and MCAP that was made of one: joint states, and a type that only the file describes."""
    path = tmp_path / name
    (bags.write_ros1 if name == "x.bag" else bags.write_ros1_mcap)(path)
    found = read(path, joint="elbow")
    assert {one.column: (one.series, one.si) for one in found.columns} == {
        "position": ("/joint_states.position[elbow]", "rad"),
        "torque": ("/joint_states.effort[elbow]", "N m"),
    }
    times, position = found.recording.signal("position")
    np.testing.assert_allclose(times, np.arange(bags.COUNT) * bags.JOINT_S, atol=1e-9)
    np.testing.assert_allclose(position, bags.angle(times), atol=1e-9)
    assert found.clock == "stamps of the headers"
    own = read(path, "current=/drive.current", joint="elbow").recording
    np.testing.assert_allclose(own.signal("current")[1], 3 * position)
    if name == "x.bag":
        path.write_bytes(path.read_bytes()[:9000])
        assert "cannot be read as ROS 1 bag: " in refused(path, joint="elbow")


def test_topics_types_and_clocks_are_chosen(bag: Path) -> None:
    """A type of somebody's own by its definition in the file; the time of receipt where it is asked for."""
    own = read(bag, "torque=/load.torque[elbow]", joint="elbow").recording
    np.testing.assert_allclose(own.signal("torque")[1], 3 * own.signal("position")[1])
    for topic_and_field in ("/load.torque", "load.torque"):
        same = read(bag, f"torque={topic_and_field}", joint="elbow")
        assert {one.column: one.series for one in same.columns}["torque"] == "/load.torque[elbow]"
    asked = read(bag, "time=log", joint="elbow")
    assert asked.recording.metadata["start"] - own.metadata["start"] == timedelta(microseconds=3000)
    fed_back = read(bag, joint="wrist", topics=("/arm_controller/controller_state",))
    assert fed_back.columns[1].series == "/arm_controller/controller_state.feedback.positions[wrist]"
    assert "found 2 joints, expected one; choose with --joint NAME (or FILE#joint=NAME) from elbow, wrist" in refused(
        bag
    )
    assert "found no topic '/jointstates' with numbers, expected one of /arm_contr" in refused(
        bag, topics=("/jointstates",)
    )


def test_mcap_with_json(tmp_path: Path) -> None:
    """Objects become names with dots, lists of named objects take these names; what is not understood is told."""
    path = tmp_path / "x.mcap"
    bags.write_json(path)
    found = read(path, "command=goal.position", joint="elbow")
    assert [one.series for one in found.columns] == ["/arm.goal.position", "/arm.joints[elbow].position"]
    np.testing.assert_allclose(found.recording.columns["position"], np.arange(bags.COUNT) * 0.2)
    assert found.notes[:1] == ["topics that are not understood: /tf (protobuf foxglove.Tf)"]


@pytest.mark.parametrize("write", [bags.write_mcap, bags.write_unindexed])
def test_mcap_without_its_end(write: Any, tmp_path: Path) -> None:
    """What a killed recorder has written is read, and told; a stump without any message is refused."""
    path = tmp_path / "x.mcap"
    write(path)
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) * 6 // 10])
    found = read(path, joint="elbow")
    count = found.recording.signal("position")[0].size
    assert 0.4 * bags.COUNT < count < 0.8 * bags.COUNT
    assert found.notes[0].startswith("the file has no end, as after a crash of the recorder")
    path.write_bytes(whole[:40])
    assert "cannot be read as MCAP: EndOfFile" in refused(path)
    path.write_bytes(whole[:100])
    assert "damage before the first message, expected some; is the file whole?" in refused(path)


def test_bags_that_are_none(tmp_path: Path) -> None:
    """A folder without its metadata, a database of something else, a damaged one."""
    bags.write_rosbag(tmp_path / "x", StoragePlugin.SQLITE3)
    (tmp_path / "x" / "metadata.yaml").unlink()
    assert read_recording(f"{tmp_path / 'x'}#joint=elbow").columns["position"].size == bags.COUNT
    database = next((tmp_path / "x").glob("*.db3"))
    database.write_bytes(database.read_bytes()[:5000])
    assert "cannot be read as rosbag2" in refused(database)
    (tmp_path / "x" / "metadata.yaml").write_text("a: [")
    assert "cannot be read as rosbag2" in refused(tmp_path / "x")


def test_a_time_that_is_no_number(tmp_path: Path) -> None:
    """A column of SQLite may hold bytes or nothing in place of the time of receipt."""
    bags.write_rosbag(tmp_path / "x", StoragePlugin.SQLITE3)
    database = next((tmp_path / "x").glob("*.db3"))
    for value in ("x'ff'", "'late'", "''"):
        with closing(sqlite3.connect(database)) as db, db:
            db.execute(f"UPDATE messages SET timestamp = {value} WHERE id % 7 = 0")
        assert "cannot be read as rosbag2" in refused(database, joint="elbow")


def test_stamps_of_two_clocks_are_not_mixed(tmp_path: Path) -> None:
    """Headers that say 0 are no stamps: receipt counts; of a few among others the messages are left out."""
    bags.write_rosbag(tmp_path / "x", StoragePlugin.MCAP, unstamped=10**9)
    assert read(tmp_path / "x", joint="elbow").clock == "when messages were received"
    bags.write_rosbag(tmp_path / "y", StoragePlugin.MCAP, unstamped=20)
    found = read(tmp_path / "y", joint="elbow")
    times, position = found.recording.signal("position")
    np.testing.assert_allclose(position, bags.angle(times), atol=1e-9)
    assert times.size == bags.COUNT - 4
    assert "8 messages without a stamp among those that have one were left out" in found.notes


def test_numbers_of_any_object() -> None:
    """Lists that belong to names, pictures left out, nesting without end."""
    deep: dict[str, Any] = {}
    for _ in range(100):
        deep = {"a": deep, "x": 1}
    assert len(dict(flat(deep))) == 12
    told = dict(
        flat({"name": ["a", "b"], "effort": [1, 2], "matrix": [[1, 2], [3, 4]], "image": [0] * 5000, "n": None})
    )
    assert told == {
        "effort[a]": 1, "effort[b]": 2, "matrix[a][0]": 1, "matrix[a][1]": 2, "matrix[b][0]": 3, "matrix[b][1]": 4
    }  # fmt: skip
    assert decoder_of("acme_msgs/msg/Broken", "cdr", "float64[ x") is None


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_any_bytes_are_answered(data: st.DataObject, tmp_path: Path) -> None:
    """Bytes in place of others in a file of each storage: a recording, or RecordingError in one line."""
    path = tmp_path / "x.mcap"
    write = data.draw(st.sampled_from([bags.write_json, bags.write_unindexed]))
    if not (whole := tmp_path / write.__name__).exists():
        write(whole)
    content = whole.read_bytes()
    begin = data.draw(st.integers(0, len(content)))
    path.write_bytes(content[:begin] + data.draw(st.binary(max_size=20)) + content[begin + 30 :])
    told = ""
    try:
        assert read(path, joint="elbow").recording.time.size > 0
    except RecordingError as error:
        told = str(error)
    assert "\n" not in told
