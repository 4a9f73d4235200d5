"""What the tests of the command line share: configurations, a filled database, and running the program."""

from __future__ import annotations

import fcntl
import math
import os
import pty
import re
import struct
import subprocess
import sys
import termios
from collections.abc import Mapping
from contextlib import suppress
from datetime import UTC, datetime, timedelta
from pathlib import Path

from click.testing import CliRunner, Result

from lostmotion.daemon.cli import cli
from lostmotion.daemon.lifecycle import raised
from lostmotion.daemon.records import Cause, Health, JointRow, ScoreRow, Severity
from lostmotion.daemon.store import Store

START = datetime(2026, 1, 1, tzinfo=UTC)
PROGRAM = [sys.executable, "-c", "from lostmotion.daemon.cli import main; main()"]

SIMULATED = """
[robot]
name = "arm1"
[store]
path = "history.db"
[simulated]
speed = "max"
[[accelerometer]]
name = "tip"
driver = "simulated"
rate_hz = 1000
oscillator = { f_res_hz = 58.0 }
[[joint]]
name = "elbow"
driver = "simulated"
accelerometer = "tip"
play_m = 8e-5
[detector]
level = 5.5
"""
SECOND_JOINT = """
[[joint]]
name = "wrist"
driver = "simulated"
accelerometer = "tip"
"""
HARDWARE = """
[robot]
name = "arm2"
[store]
path = "history.db"
[[accelerometer]]
name = "tip"
driver = "witmotion"
port = "no-such-port-1"
baudrate = 115200
rate_hz = 200
oscillator = { f_res_hz = 58.0 }
[[joint]]
name = "elbow"
driver = "dynamixel"
port = "no-such-port-0"
baudrate = 1000000
model = "AX-12A"
id = 3
accelerometer = "tip"
"""


def call(*arguments: str | Path) -> Result:
    """The command line in this process."""
    return CliRunner().invoke(cli, [str(argument) for argument in arguments])


def in_terminal(width: int, *arguments: str | Path) -> str:
    """What the program shows in a terminal of so many columns, without colours."""
    kept = {name: value for name, value in os.environ.items() if name not in ("COLUMNS", "LINES")}
    return re.sub(r"\x1b\[[0-9;]*m|\r", "", shown(kept | {"TERM": "xterm"}, *arguments, width=width))


def shown(environment: Mapping[str, str], *arguments: str | Path, width: int | None = None) -> str:
    """What the program sends to a terminal, of so many columns where that is given."""
    master, slave = pty.openpty()
    if width is not None:
        fcntl.ioctl(slave, termios.TIOCSWINSZ, struct.pack("HHHH", 40, width, 0, 0))
    process = subprocess.Popen([*PROGRAM, *map(str, arguments)], stdout=slave, env=environment)
    os.close(slave)
    text = b""
    with suppress(OSError):  # the end of a pseudo-terminal
        while piece := os.read(master, 65536):
            text += piece
    os.close(master)
    assert process.wait(60) == 0
    return text.decode()


def start(*arguments: str | Path, folder: Path) -> subprocess.Popen[str]:
    """The program in a process of its own."""
    command = [*PROGRAM, *(str(argument) for argument in arguments)]
    return subprocess.Popen(command, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def is_one_line(result: Result, *words: str) -> bool:
    """Whether the program refused with status 2 and one line on stderr that holds these words."""
    line = result.stderr
    return result.exit_code == 2 and line.count("\n") == 1 and not result.stdout and all(word in line for word in words)


def fill(path: Path, count: int = 200, per_year: float = 6.0) -> None:
    """A year of scores: the elbow's rise by ``per_year`` from 1, exactly; the shoulder's last one is unknown."""
    store = Store(path, "arm1")
    for k in range(count):
        time, score = START + timedelta(days=365.25 * k / count), 1 + per_year * k / count
        sizes = {"severity": 0.001, "severity_low": 0.0008, "severity_high": 0.002}
        store.add(ScoreRow("elbow", time, 0.25, score, 4.0, score > 4, 0.001, 0.0009, 0.0011, **sizes))
        store.add(ScoreRow("shoulder", time, 0.25, 1.5 if k < count - 1 else math.nan, 4.0, False, quality="gap"))
    store.add(JointRow("shoulder"))
    store.add(JointRow("elbow", Health.WARNING, "half of the windows", START))
    store.add(raised("elbow", Cause.PLAY, Severity.WARNING, "half of the windows", START))
    store.close()
