"""docs/lerobot.md, from its first command to its last, on the emulated arm that it starts itself."""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from lostmotion.daemon import config
from lostmotion.daemon.reader import open_readonly
from tests.conftest import ROOT
from tests.daemon.cli_world import PROGRAM
from tests.test_readme import commands

PAGE = (ROOT / "docs" / "lerobot.md").read_text()
PORTS = {"/dev/ttyACM0": "arm.0", "/dev/ttyUSB0": "arm.1"}


@pytest.fixture
def arm(tmp_path: Path) -> Iterator[Path]:
    """The emulator, started by the page's own line; the folder of its ports."""
    line = re.search(r"^ +python (-m lostmotion.drivers.emulator .*) --link /tmp/arm$", PAGE, re.MULTILINE)
    assert line
    command = [sys.executable, *line[1].split(), "--link", str(tmp_path / "arm")]
    emulator = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert emulator.stdout is not None
    assert emulator.stdout.readline().strip() == str(tmp_path / "arm.0")
    try:
        yield tmp_path
    finally:
        emulator.terminate()
        emulator.wait(20)


def run(command: str, folder: Path) -> subprocess.CompletedProcess[str]:
    """A command of the page, with the emulator's ports."""
    for name, link in PORTS.items():
        command = command.replace(name, str(folder / link))
    program, *arguments = shlex.split(command)
    assert program == "lostmotion"
    return subprocess.run([*PROGRAM, *arguments], cwd=folder, capture_output=True, text=True, timeout=300)


@pytest.mark.slow
def test_every_command_of_the_page_runs(arm: Path) -> None:
    """All succeed, one after another, up to scores of all six joints; the six have LeRobot's names and ids."""
    shown = commands(PAGE)
    assert [command.split()[1] for command in shown] == ["doctor", "config", "doctor", "run", "status", "history"]
    for command in shown:
        done = run(command, arm)
        busy = int(command.startswith("lostmotion doctor --config"))  # a loaded machine polls too slowly
        assert done.returncode <= busy, f"{command}\n{done.stdout}{done.stderr}"
        assert "Traceback" not in done.stderr
        if command.startswith("lostmotion doctor --find"):
            assert "feetech STS3215 (model number 777)" in done.stdout
            assert "id 1, 2, 3, 4, 5, 6" in done.stdout
            assert "csv_serial at 1000 Hz" in done.stdout
    found = config.load(arm / "so101.toml")
    table = re.search(r"^\| joint \| (.*) \|$", PAGE, re.MULTILINE)
    assert table
    assert [joint.name for joint in found.joints] == table[1].split(" | ")
    assert [joint.port for joint in found.joints] == [str(arm / "arm.0")] * 6
    with open_readonly(arm / "history.db") as reader:
        counts = {joint.name: sum(1 for _ in reader.scores(joint.name)) for joint in found.joints}
    assert all(count >= 3 for count in counts.values()), counts
