"""LeRobot's datasets as versions 2.1 and 3.0 lay them out: joints, episodes, exact times, and assumed units."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from pyarrow import parquet

from lostmotion.drivers.errors import RecordingError
from lostmotion.drivers.formats.choice import parse_map
from lostmotion.drivers.formats.read import Imported, imported
from lostmotion.drivers.formats.source import Choice
from lostmotion.drivers.recording import read_recording

JOINTS = ["shoulder_pan.pos", "elbow_flex.pos", "gripper.pos"]
FRAMES, FPS = 90, 30


def read(path: Path, *terms: str, **choice: Any) -> Imported:
    """What is taken of a dataset, with ``--map``."""
    return imported(path, Choice(parse_map(terms), **choice))


def state(episode: int) -> Any:
    """Of the joints, in degrees, shape (FRAMES, 3); actions are a degree ahead."""
    swing = np.sin(np.arange(FRAMES) / 9 + episode)
    return np.column_stack([30 * swing, -90 * swing, np.full(FRAMES, 50.0)]).astype(np.float32)


def table(episode: int, scale: float) -> pa.Table:
    """An episode as LeRobot writes it: lists of float32 of one length."""
    lists = [pa.FixedSizeListArray.from_arrays(pa.array((values * scale).ravel(), pa.float32()), 3)
             for values in (state(episode), state(episode) + 1)]  # fmt: skip
    frame = np.arange(FRAMES)
    return pa.table({
        "observation.state": lists[0], "action": lists[1], "timestamp": pa.array(frame / FPS, pa.float32()),
        "frame_index": frame, "episode_index": np.full(FRAMES, episode), "index": frame,
    })  # fmt: skip


def dataset(path: Path, version: str, names: Any = JOINTS, episodes: int = 3, scale: float = 1.0) -> Path:
    """A folder of that version."""
    vector = {"dtype": "float32", "shape": [3], "names": names}
    number = {"dtype": "int64", "shape": [1], "names": None}
    features = {
        "observation.state": vector, "action": vector, "timestamp": {**number, "dtype": "float32"},
        "episode_index": number, "observation.images.top": {"dtype": "video", "shape": [480, 640, 3], "names": ["h"]},
    }  # fmt: skip
    info = {"codebase_version": version, "fps": FPS, "total_episodes": episodes, "features": features}
    for folder in ("meta", "data/chunk-000"):
        (path / folder).mkdir(parents=True)
    (path / "meta" / "info.json").write_text(json.dumps(info))
    tables = [table(episode, scale) for episode in range(episodes)]
    if version.startswith("v2"):
        for episode, each in enumerate(tables):
            parquet.write_table(each, path / f"data/chunk-000/episode_{episode:06d}.parquet")
    else:
        parquet.write_table(pa.concat_tables(tables), path / "data/chunk-000/file-000.parquet")
    return path


@pytest.mark.parametrize("version", ["v2.1", "v3.0"])
def test_a_joint_of_an_episode(version: str, tmp_path: Path) -> None:
    """State is the position, action the command; times are whole frames although float32 rounded them."""
    path = dataset(tmp_path / "set", version)
    found = read(path, joint="elbow_flex", episode=2)
    assert [one.series for one in found.columns] == ["action[elbow_flex.pos]", "observation.state[elbow_flex.pos]"]
    np.testing.assert_allclose(found.recording.columns["position"], np.radians(state(2)[:, 1]), rtol=1e-6)
    np.testing.assert_allclose(found.recording.columns["command"], np.radians(state(2)[:, 1] + 1), rtol=1e-5)
    np.testing.assert_array_equal(found.recording.time, np.arange(FRAMES) / FPS)
    assert found.kind == f"LeRobot dataset {version}"
    assert read_recording(f"{path}#joint=gripper,episode=0").metadata["joint"] == "gripper"


def test_units_are_assumed_aloud(tmp_path: Path) -> None:
    """Beyond 100 degrees, to 100 perhaps normalised, to 4 pi rad; --map overrules it."""
    normalised = read(dataset(tmp_path / "a", "v3.0", episodes=1), joint="elbow_flex")
    assert "recorded without use_degrees they are -100 to 100 of a joint's range" in normalised.notes[0]
    degrees = read(dataset(tmp_path / "b", "v3.0", episodes=1, scale=1.5), joint="elbow_flex")
    assert degrees.notes[0] == "LeRobot has no unit: numbers up to 136.4 are taken as degrees"
    simulated = read(dataset(tmp_path / "c", "v3.0", episodes=1, scale=np.pi / 180), joint="elbow_flex")
    np.testing.assert_allclose(simulated.recording.columns["position"], np.radians(state(0)[:, 1]), rtol=1e-5)
    said = read(tmp_path / "a", "position=observation.state[elbow_flex.pos]*0.02", joint="elbow_flex")
    np.testing.assert_allclose(said.recording.columns["position"], 0.02 * state(0)[:, 1], rtol=1e-6)


JAWED = ["base", "elbow", "jaw"]


@pytest.mark.parametrize("names", [{"motors": JAWED}, [JAWED], ["motors"], None])
def test_names_come_in_several_forms(names: Any, tmp_path: Path) -> None:
    """In an object, in a list of lists, one name for all, none: then joints have their numbers."""
    path = dataset(tmp_path / "set", "v3.0", names, episodes=1)
    joint = "jaw" if names and JAWED in [*(names.values() if isinstance(names, dict) else names)] else "2"
    np.testing.assert_allclose(read(path, joint=joint).recording.columns["position"], np.radians(50), rtol=1e-6)


def test_what_is_no_dataset_is_told(tmp_path: Path) -> None:
    """Several episodes or joints, one that is not there, damaged descriptions and tables."""
    path = dataset(tmp_path / "set", "v3.0")
    for choice, message in (
        ({}, "found 3 joints, expected one"),
        ({"joint": "gripper"}, "found 3 episodes, expected one; choose with --episode N"),
        ({"joint": "gripper", "episode": 9}, "found no rows of episode 9, expected one of 0 to 2"),
    ):  # fmt: skip
        with pytest.raises(RecordingError, match=message):
            read(path, **choice)
    (path / "data/chunk-000/file-000.parquet").write_bytes(b"PAR1 no more")
    with pytest.raises(RecordingError, match="cannot be read as Parquet"):
        read(path, joint="gripper", episode=0)
    (path / "data/chunk-000/file-000.parquet").unlink()
    with pytest.raises(RecordingError, match="expected episodes; was a part downloaded"):
        read(path, joint="gripper")
    for text in ("{", "[]", '{"features": 1}', '{"features": {"a": 1}}', '{"features": {}, "fps": "x"}'):
        (path / "meta/info.json").write_text(text)
        with pytest.raises(RecordingError, match=r"info\.json: found no"):
            read(path, joint="gripper")
