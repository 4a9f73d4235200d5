"""docs/canopen.md, from its first command to its last, with the example's configuration on the bus that the page's own
emulator serves."""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from lostmotion.daemon.reader import open_readonly
from tests.conftest import ROOT
from tests.daemon.cli_world import PROGRAM
from tests.test_readme import commands

PAGE = (ROOT / "docs" / "canopen.md").read_text()
EXAMPLE = (ROOT / "examples" / "canopen.toml").read_text()
ON_ADAPTER = ('port = "can0"', 'interface = "socketcan"', 'port = "/tmp/can.0"', 'interface = "slcan"')
"""what the page says to change for the emulator"""


@pytest.fixture
def robot(tmp_path: Path) -> Iterator[Path]:
    """The emulator, started by the page's own line; the folder with its port and the configuration."""
    line = re.search(r"^ +python (-m lostmotion.drivers.emulator .*) --link /tmp/can$", PAGE, re.MULTILINE)
    assert line
    command = [sys.executable, *line[1].split(), "--link", str(tmp_path / "can")]
    emulator = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    try:
        assert emulator.stdout is not None
        assert emulator.stdout.readline().strip() == str(tmp_path / "can.0")
        text = EXAMPLE.replace("/var/lib/lostmotion", str(tmp_path))
        for old, new in zip(ON_ADAPTER[:2], ON_ADAPTER[2:], strict=True):
            assert new in PAGE
            assert EXAMPLE.count(old) == 3
            text = text.replace(old, new)
        (tmp_path / "canopen.toml").write_text(text.replace("/tmp/can.0", str(tmp_path / "can.0")))
        yield tmp_path
    finally:
        emulator.terminate()
        emulator.wait(20)


def run(command: str, folder: Path) -> subprocess.CompletedProcess[str]:
    """A command of the page."""
    program, *arguments = shlex.split(command)
    assert program == "lostmotion"
    return subprocess.run([*PROGRAM, *arguments], cwd=folder, capture_output=True, text=True, timeout=300)


@pytest.mark.slow
def test_every_command_of_the_page_runs(robot: Path) -> None:
    """All succeed, one after another, up to scores of both joints; the doctor finds each node at the SYNC's rate."""
    shown = commands(PAGE)
    assert [command.split()[1] for command in shown] == ["config", "doctor", "run", "status", "history"]
    for command in shown:
        done = run(command, robot)
        busy = int(command.startswith("lostmotion doctor"))  # a loaded machine reads too slowly
        assert done.returncode <= busy, f"{command}\n{done.stdout}{done.stderr}"
        assert "Traceback" not in done.stderr
        if busy:
            found = re.sub(r"\s+", " ", done.stdout)
            for node, joint in ((1, "shoulder"), (2, "elbow")):
                assert joint in found
                assert f"node {node}: position in 0x18{node}" in found
    with open_readonly(robot / "history.db") as reader:
        counts = {name: sum(1 for _ in reader.scores(name)) for name in ("shoulder", "elbow")}
    assert all(count >= 3 for count in counts.values()), counts
