"""What a person sees while a command computes."""

from __future__ import annotations

import os
import pty
import subprocess
import sys
from pathlib import Path

import pytest


@pytest.fixture
def swing(tmp_path: Path) -> Path:
    """A recording of a free swing that also has what a score needs."""
    rows = [f"{k / 100},{0.3 * (-1) ** (k // 50)},{0.5 - k / 1000},0.1" for k in range(400)]
    path = tmp_path / "swing.csv"
    path.write_text("\n".join(["time,command,position,accel", *rows]) + "\n")
    return path


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["score", "--f-res-hz", "20"], "scoring"),
        pytest.param(["lab", "compare", "joint"], "comparing", marks=pytest.mark.slow),
        pytest.param(["lab", "fit", "joint", "-o", "fitted.toml"], "starting", marks=pytest.mark.slow),
    ],
)
def test_a_terminal_shows_that_a_command_computes(swing: Path, arguments: list[str], told: str) -> None:
    """From the beginning, on stderr alone; nothing of it goes to a file."""
    master, terminal = pty.openpty()
    command = [sys.executable, "-m", "lostmotion", *arguments, str(swing)]
    where = {"cwd": swing.parent, "env": {**os.environ, "TERM": "xterm"}}
    done = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=terminal, **where)  # type: ignore[call-overload]
    os.close(terminal)
    seen = b""
    while chunk := _read(master):
        seen += chunk
    printed, _ = done.communicate()
    os.close(master)
    assert told in seen.decode()
    assert told.encode() not in printed


def _read(master: int) -> bytes:
    """The next bytes of a terminal; none when all of its programs have ended."""
    try:
        return os.read(master, 65536)
    except OSError:
        return b""
