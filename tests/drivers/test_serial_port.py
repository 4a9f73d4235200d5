"""Ports that are missing, busy, forbidden or no ports at all: what the user is told."""

from __future__ import annotations

import os
import threading
import time
from pathlib import Path

import pytest

from lostmotion.drivers.emulator import Emulator, TextStream
from lostmotion.drivers.errors import PortError
from lostmotion.drivers.serial_port import SerialPort


def test_a_missing_port_is_named(tmp_path: Path) -> None:
    """The message says which port, and that it may be unplugged or called otherwise."""
    with pytest.raises(PortError, match=r"ttyUSB7 does not exist; likely cause: unplugged"):
        SerialPort(str(tmp_path / "ttyUSB7"), 115200).open()


def test_no_port_at_all() -> None:
    """An empty name is told as such."""
    with pytest.raises(PortError, match="no port is named"):
        SerialPort("", 115200).open()


def test_a_file_is_no_port(tmp_path: Path) -> None:
    """A plain file opens, but is no serial port."""
    (tmp_path / "notes").touch()
    with pytest.raises(PortError, match=r"no usable serial port .* likely cause: a wrong name"):
        SerialPort(str(tmp_path / "notes"), 115200).open()


def test_a_forbidden_port_names_the_group(tmp_path: Path) -> None:
    """Without permission the likely cause is the group dialout."""
    port = tmp_path / "ttyUSB0"
    port.touch(mode=0o000)
    me = os.geteuid()
    if me == 0:  # root may open everything
        os.seteuid(65534)
    try:
        with pytest.raises(PortError, match="group dialout"):
            SerialPort(str(port), 115200).open()
    finally:
        os.seteuid(me)


def test_a_busy_port_stays_with_its_first_owner() -> None:
    """A second program is turned away, and may have the port once the first has closed it."""
    with Emulator(TextStream()) as emulator:
        first, second = (SerialPort(emulator.paths[0], 115200) for _ in range(2))
        first.open()
        with pytest.raises(PortError, match="is busy; likely cause: another program"):
            second.open()
        assert first.read(1.0)
        first.close()
        second.open()
        assert second.read(1.0)
        second.close()


def test_old_input_is_forgotten_when_opened() -> None:
    """What a device sent before the port was opened is not read."""
    with Emulator(TextStream(b"x" * 100)) as emulator:
        time.sleep(0.5)
        port = SerialPort(emulator.paths[0], 115200)
        port.open()
        assert len(port.read(1.0)) <= 200
        port.close()


def test_closing_from_another_thread_ends_a_read() -> None:
    """A reader that waits gets its answer or a PortError, never a crash on a stale descriptor."""
    with Emulator(TextStream(b"")) as emulator:
        port = SerialPort(emulator.paths[0], 115200)
        port.open()
        ended: list[str] = []

        def reader() -> None:
            try:
                while True:
                    port.read(0.2)
            except PortError as error:
                ended.append(str(error))

        thread = threading.Thread(target=reader)
        thread.start()
        port.close()
        thread.join(60)
        assert ended == [f"port {emulator.paths[0]} is not open"]


def test_unplugged_and_plugged_in_again(tmp_path: Path) -> None:
    """Reading and writing a port that is gone raise PortError; opened again at the same path it works."""
    with Emulator(TextStream(b"tick\n"), link=tmp_path / "tty") as emulator:
        port = SerialPort(emulator.paths[0], 115200)
        port.open()
        assert b"tick" in port.read(1.0)
        emulator.unplug()
        for action in (lambda: [port.read(0.1) for _ in range(3)], lambda: port.write(b"x"), port.discard_input):
            with pytest.raises(PortError, match=r"went away .* likely cause: unplugged"):
                action()
        with pytest.raises(PortError, match="does not exist"):
            port.open()
        emulator.plug()
        port.open()
        assert b"tick" in port.read(1.0)
        port.close()
