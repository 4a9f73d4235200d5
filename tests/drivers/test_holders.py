"""A port that another process has open: real pseudo-terminals and real processes, with and without locks."""

from __future__ import annotations

import os
import subprocess
import sys
import time
import tty
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from lostmotion.drivers.emulator import Emulator, TextStream
from lostmotion.drivers.errors import PortError
from lostmotion.drivers.holders import LONGEST_NAME, holders
from lostmotion.drivers.serial_port import SerialPort

READER = "import os, sys, time; fd = os.open(sys.argv[1], os.O_RDWR | os.O_NOCTTY); print(flush=True); "
SLEEPING = READER + "time.sleep(60)  # the robot's controller"
STEALING = (
    READER
    + """
os.set_blocking(fd, False)
while True:
    try:
        os.read(fd, 4096)
    except BlockingIOError:
        pass
"""
)
DROPPING = "import os; os.setgid(65534); os.setuid(65534); "


@contextmanager
def program(text: str, path: str | Path) -> Iterator[subprocess.Popen[str]]:
    """Another process that has opened the port."""
    command = [sys.executable, "-c", text, str(path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        try:
            assert process.stdout.readline() == "\n"
            yield process
        finally:
            process.kill()


@pytest.fixture
def terminal() -> Iterator[tuple[int, str]]:
    """A pseudo-terminal whose far end, like an adapter, is no process's concern: its number, and its path."""
    master, slave = os.openpty()
    tty.setraw(slave)
    path = os.ttyname(slave)
    os.close(slave)
    yield master, path
    os.close(master)


def test_a_port_that_another_program_has_open_is_refused_by_name(terminal: tuple[int, str]) -> None:
    """No lock is held: process and command line are told, and the port is had once the program has ended."""
    _, path = terminal
    port = SerialPort(path, 115200)
    with program(SLEEPING, path) as controller, pytest.raises(PortError) as refused:
        port.open()
    assert f"port {path} is open in another program, process {controller.pid} (" in str(refused.value)
    assert f"{sys.executable} -c {SLEEPING}"[:LONGEST_NAME] in str(refused.value)
    assert "\n" not in str(refused.value)
    port.open()
    port.close()


def test_another_name_is_the_same_port(tmp_path: Path, terminal: tuple[int, str]) -> None:
    """The controller has opened a link, lostmotion is given another, as udev makes them."""
    for name in ("by-id", "by-path"):
        (tmp_path / name).symlink_to(terminal[1])
    with (
        program(SLEEPING, tmp_path / "by-id") as controller,
        pytest.raises(PortError, match=f"process {controller.pid} "),
    ):
        SerialPort(str(tmp_path / "by-path"), 115200).open()


def test_other_ports_and_what_is_no_port_have_no_holders(tmp_path: Path, terminal: tuple[int, str]) -> None:
    """Only the same device counts; a missing one, a file and the null device of others are no busy ports."""
    with Emulator(TextStream()) as emulator, program(SLEEPING, terminal[1]):
        assert holders(emulator.paths[0]) == []
    (tmp_path / "file").touch()
    assert holders(str(tmp_path / "file")) == holders(str(tmp_path / "missing")) == []


def test_the_far_end_of_a_pseudo_terminal_is_the_device(tmp_path: Path) -> None:
    """An emulator in another process keeps both ends open, and its port can be opened."""
    link = tmp_path / "port"
    text = (
        "import os, sys, time, tty; far, near = os.openpty(); tty.setraw(near);"
        "os.symlink(os.ttyname(near), sys.argv[1]); print(flush=True); time.sleep(60)"
    )
    with program(text, link):
        port = SerialPort(str(link), 115200)
        port.open()
        assert port.is_open
        port.close()


def test_while_it_is_open_other_users_are_refused(terminal: tuple[int, str]) -> None:
    """TIOCEXCL: a program without root's rights cannot open the port, lock or not; after closing it can."""
    if os.geteuid() != 0:
        pytest.skip("only root can become another user")
    _, path = terminal
    Path(path).chmod(0o666)
    port = SerialPort(path, 115200)
    port.open()
    command = [sys.executable, "-c", DROPPING + SLEEPING.replace("60", "0"), path]
    refused = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert "Device or resource busy" in refused.stderr
    port.close()
    assert subprocess.run(command, capture_output=True, timeout=60).returncode == 0


def test_a_second_reader_that_root_let_in_is_noticed(terminal: tuple[int, str]) -> None:
    """It takes bytes that were announced: told as what it is, and not as an unplugged cable."""
    if os.geteuid() != 0:
        pytest.skip("only root opens a port that is held")
    master, path = terminal
    port = SerialPort(path, 115200)
    port.open()
    told = ""
    with program(STEALING, path):
        end = time.monotonic() + 20
        while not told and time.monotonic() < end:
            os.write(master, b"x" * 10)
            try:
                port.read(0.01)
            except PortError as error:
                told = str(error)
    port.close()
    assert "is read by another program, too" in told
