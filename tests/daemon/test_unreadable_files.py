"""Files that this user may not read: each command says so in words about the file, with the likely cause."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from tests.daemon.cli_world import SIMULATED, call, fill, is_one_line
from tests.daemon.test_store import another_user

SUDO = "does it belong to the service's user? then use sudo"
USER = "may this user read it?"

pytestmark = pytest.mark.skipif(os.geteuid() != 0, reason="needs to give up root's rights to read everything")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A database, a configuration and a recording in a folder, into which everybody may look."""
    fill(tmp_path / "history.db", 5)
    (tmp_path / "robot.toml").write_text(SIMULATED)
    (tmp_path / "rec.csv").write_text("time,accel\n0,0\n1,0\n2,0\n")
    for parent in [*tmp_path.parents][:-2]:
        parent.chmod(parent.stat().st_mode | 0o055)
    return tmp_path


@pytest.mark.parametrize("is_file", [True, False])
@pytest.mark.parametrize(
    ("file", "cause", "words"),
    [
        ("history.db", SUDO, ("status", "--database")),
        ("history.db", SUDO, ("history", "elbow", "--database")),
        ("history.db", SUDO, ("alarms", "ack", "elbow", "--database")),
        ("robot.toml", "a configuration file was expected", ("config", "check")),
        ("robot.toml", "a configuration file was expected", ("status", "--config")),
        ("rec.csv", USER, ("score",)),
        ("rec.csv", USER, ("import",)),
        ("rec.csv", USER, ("lab", "compare", "oscillator")),
    ],
)
def test_a_file_that_may_not_be_read(
    folder: Path, file: str, cause: str, words: tuple[str, ...], is_file: bool
) -> None:
    """Whether the file itself is closed or its folder: one line with the path, the reason and the likely cause."""
    path = folder / file
    call(*words, path)  # imports, which another user may not do
    (path if is_file else folder).chmod(0)
    with another_user():
        result = call(*words, path)
    folder.chmod(0o755)
    assert is_one_line(result, f"{path}: cannot be read: Permission denied", cause), result.stderr
