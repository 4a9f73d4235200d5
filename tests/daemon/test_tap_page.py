"""docs/tap.md, from its first command to its last, on the emulated arm and master that it starts itself."""

from __future__ import annotations

import re
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

PAGE = (ROOT / "docs" / "tap.md").read_text()
EXAMPLE = (ROOT / "examples" / "tap.toml").read_text()


@pytest.fixture
def arm(tmp_path: Path) -> Iterator[Path]:
    """The emulator, started by the page's own line; the folder of its ports and of the example."""
    line = re.search(r"^ +python (-m lostmotion.drivers.emulator .*) --link /tmp/arm$", PAGE, re.MULTILINE)
    assert line
    command = [sys.executable, *line[1].split(), "--link", str(tmp_path / "arm")]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as emulator:
        assert emulator.stdout is not None
        try:
            assert emulator.stdout.readline().strip() == str(tmp_path / "arm.0")
            text = EXAMPLE.replace("/var/lib/lostmotion/history.db", "history.db")
            for name, link in {"/dev/ttyUSB1": "arm.0", "/dev/ttyUSB0": "arm.1"}.items():
                text = text.replace(name, str(tmp_path / link))
            (tmp_path / "tap.toml").write_text(text)
            yield tmp_path
        finally:
            emulator.terminate()


@pytest.mark.slow
def test_every_command_of_the_page_runs(arm: Path) -> None:
    """All succeed, one after another, up to scores of all six joints, whose goals were heard."""
    shown = [command.split() for command in commands(PAGE)]
    assert [command[1] for command in shown] == ["config", "doctor", "run", "status"]
    for _, *arguments in shown:
        done = subprocess.run([*PROGRAM, *arguments], cwd=arm, capture_output=True, text=True, timeout=300)
        busy = int(arguments[0] == "doctor")  # a loaded machine loses samples
        assert done.returncode <= busy, f"{arguments}\n{done.stdout}{done.stderr}"
        assert "Traceback" not in done.stderr
        if arguments[0] == "doctor":
            assert done.stdout.count("goals received") == 6, done.stdout
    found = config.load(arm / "tap.toml")
    with open_readonly(arm / "history.db") as reader:
        counts = {joint.name: sum(1 for _ in reader.scores(joint.name)) for joint in found.joints}
    assert all(count >= 3 for count in counts.values()), counts
