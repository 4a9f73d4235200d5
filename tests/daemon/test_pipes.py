"""Commands in a pipe: ``-`` is standard input, or standard output."""

from __future__ import annotations

import io
import json
import subprocess
from pathlib import Path

import pytest

from lostmotion.drivers.recording import read_recording
from tests.daemon.cli_world import PROGRAM, SIMULATED, call, fill, is_one_line


def piped(*arguments: str | Path, given: bytes = b"", folder: Path | None = None) -> bytes:
    """What the program writes to standard output; it must succeed."""
    done = subprocess.run(
        [*PROGRAM, *map(str, arguments)], input=given, capture_output=True, check=False, timeout=120, cwd=folder
    )
    assert done.returncode == 0, done.stderr.decode()
    return done.stdout


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A joint with play for three seconds."""
    path = tmp_path_factory.mktemp("pipes") / "rec.csv"
    assert call("simulate", "play", "-o", path, "--motion", "hand-waved:1", "--duration", "3").exit_code == 0
    return path


@pytest.mark.slow
def test_recordings_go_through_pipes(recording: Path, tmp_path: Path) -> None:
    """Simulated, converted there and back, and scored: the same as with files, and nothing else on standard output."""
    text = recording.read_bytes()
    assert piped("simulate", "play", "-o", "-", "--motion", "hand-waved:1", "--duration", "3") == text
    back = piped("import", "-", "-o", "-", given=piped("export", "-", "-o", "-", given=text))
    (tmp_path / "back.csv").write_bytes(back)
    assert read_recording(tmp_path / "back.csv").columns.keys() == read_recording(recording).columns.keys()
    scored = json.loads(piped("score", "-", "--json", given=text))["windows"]
    assert scored == json.loads(piped("score", recording, "--json"))["windows"]
    assert scored
    assert b"fit %" in piped("lab", "compare", "play", "-", given=text)


def test_a_recorder_leaves_what_is_there(tmp_path: Path) -> None:
    """Behind what another command has written into the same file, the recording begins."""
    config = tmp_path / "robot.toml"
    config.write_text(SIMULATED)
    path = tmp_path / "out.csv"
    with path.open("ab") as file:
        file.write(b"# first = true\n")
        file.flush()
        command = [*PROGRAM, "record", "--config", str(config), "--duration", "1", "-o", "-"]
        subprocess.run(command, stdout=file, stderr=subprocess.PIPE, check=True, timeout=120)
    found = read_recording(path)
    assert found.metadata["first"] is True
    assert found.duration == pytest.approx(1.0, abs=0.1)


def test_a_recorder_ends_with_its_reader(tmp_path: Path) -> None:
    """``record -o - | head``: the status of a closed pipe, and no talk of a full disk."""
    config = tmp_path / "robot.toml"
    config.write_text(SIMULATED)
    command = [*PROGRAM, "record", "--config", str(config), "--duration", "1", "-o", "-"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    assert process.stdout
    assert process.stderr
    process.stdout.close()
    assert process.wait(120) == 141
    assert b"cannot be written" not in process.stderr.read()
    process.stderr.close()


def test_a_history_goes_through_a_pipe_as_parquet(tmp_path: Path) -> None:
    """All rows, and no words."""
    parquet = pytest.importorskip("pyarrow.parquet")
    fill(tmp_path / "history.db", count=20)
    told = piped("history", "elbow", "--database", tmp_path / "history.db", "--parquet", "-")
    assert parquet.read_table(io.BytesIO(told)).num_rows == 20


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("simulate", "play", "-o", "-", "--json"), "--json and -o -"),
        (("record", "--config", "robot.toml", "--duration", "1", "-o", "-", "--json"), "--json and -o -"),
        (("lab", "add", "play", "coulomb_friction", "-o", "-"), "expected the name of a file"),
        (("calibrate", "bar", "--diameter", "3mm", "--length", "90mm", "--tip", "0g", "-o", "-"), "is printed in any"),
        (("score", "-"), "stdin: found no header"),
    ],
)
def test_what_a_pipe_cannot_take_is_refused(arguments: tuple[str, ...], words: str) -> None:
    """One line, status 2: two documents on one standard output, a file of lines that are printed anyway, nothing."""
    assert is_one_line(call(*arguments), words)
