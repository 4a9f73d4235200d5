"""One serial port: opening it with errors that have the likely cause, reading without busy waiting, losing it.

``codec`` decodes the bytes.
"""

from __future__ import annotations

import contextlib
import errno
import fcntl
import os
import select
import termios
import threading
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Protocol

import serial

from lostmotion.drivers.errors import PortError
from lostmotion.drivers.holders import holders

__all__ = ["Exchange", "SerialPort"]

CHUNK = 4096
"""as many bytes as a Linux tty holds"""


HUNG_UP = select.POLLHUP | select.POLLERR | select.POLLNVAL


class Exchange(Protocol):
    """What is asked, and how the answer begins and how long it is [bytes]."""

    request: bytes
    start: bytes
    length: int


class SerialPort:
    """A serial port that no other process has open, as far as this one may see (``holders.py``).

    While it is open the kernel refuses it to other programs (TIOCEXCL), but not to root's (CAP_SYS_ADMIN); a program
    that reads from it all the same is noticed by bytes that are announced and then not there.
    ``close`` may come from another thread at any time: a ``read`` under way ends first, the next raises PortError.
    """

    def __init__(self, path: str, baudrate: int) -> None:
        self.path = path
        self.baudrate = baudrate
        self._serial: serial.Serial | None = None
        self._number = -1  # the file descriptor, while it is open
        self._busy = threading.RLock()
        self._poll = select.poll()

    def open(self) -> None:
        """Takes the port, raw, and forgets what had come in before.  Raises PortError with the likely cause."""
        self.close()
        self._refuse_a_second_master()  # before opening, which restarts some microcontrollers
        try:
            device = self._connect()
            fcntl.ioctl(device.fileno(), termios.TIOCEXCL)
        except (OSError, ValueError, termios.error) as error:
            raise PortError(self._explain(error)) from error
        try:
            self._refuse_a_second_master()  # from here on only root can open it
        except PortError:
            _release(device)
            raise
        self._poll = select.poll()
        self._poll.register(device.fileno(), select.POLLIN)
        self._serial, self._number = device, device.fileno()

    @property
    def is_open(self) -> bool:
        """Whether the port is held."""
        return self._serial is not None

    def read(self, timeout_s: float) -> bytes:
        """Everything that has come in; waits up to ``timeout_s`` for something, then returns nothing.

        Raises PortError when the port is closed or gone.
        """
        with self._busy:
            return self._receive(self._fd(), max(0.0, timeout_s * 1000))

    def converse(
        self, exchanges: Iterable[Exchange], timeout_s: float, now: Callable[[], float], turns: Iterable[None] = (None,)
    ) -> tuple[list[tuple[float, bytes]], bool]:
        """In each turn sends a request, waits for its answer, sends the next one: the time ``now`` of each, and what
        came in; and whether all of that looks like answers.

        The first answer that begins otherwise, or is of another length, ends it; that is b"" where none came within
        ``timeout_s``.  ``turns`` waits for the next turn, and ends after the last.  Raises PortError when the port is
        closed or gone.

        All requests of many turns in one call, with nothing else between them: what Python does right after a wait
        costs several times as much as at other times, because the caches are cold.
        """
        answers: list[tuple[float, bytes]] = []
        write, read, timeout_ms = os.write, os.read, timeout_s * 1000
        with self._busy:
            fd, answered = self._fd(), self._poll.poll
            try:
                for _ in turns:
                    for exchange in exchanges:
                        asked, answer = now(), b""
                        write(fd, exchange.request)
                        if answered(timeout_ms) and not (answer := read(fd, CHUNK)):
                            raise self._gone(None)
                        answers.append((asked, answer))
                        if len(answer) != exchange.length or not answer.startswith(exchange.start):
                            return answers, False
            except BlockingIOError:  # the line takes nothing, or another reader was quicker
                answers.append((asked, b""))
                return answers, False
            except OSError as error:
                raise self._gone(error) from error
        return answers, True

    def write(self, data: bytes) -> int:
        """Sends the bytes; how many the port took.  Raises PortError when the port is closed or gone."""
        with self._busy:
            return self._send(self._fd(), data)

    def discard_input(self) -> None:
        """Forgets what has come in.  Raises PortError when the port is closed or gone."""
        with self._busy:
            fd = self._fd()
            try:
                termios.tcflush(fd, termios.TCIFLUSH)
            except termios.error as error:
                raise self._gone(error) from error

    def close(self) -> None:
        """Gives the port back."""
        device, self._serial = self._serial, None
        if device is None:
            return
        with self._busy:
            _release(device)

    def _connect(self) -> serial.Serial:
        return serial.Serial(self.path, self.baudrate, timeout=0, exclusive=True)

    def _receive(self, fd: int, timeout_ms: float) -> bytes:
        try:
            if not self._poll.poll(timeout_ms):
                return b""
            data = os.read(fd, CHUNK)
        except BlockingIOError:  # another reader was quicker: a program that ignores the lock
            return b""
        except OSError as error:
            raise self._gone(error) from error
        if not data:  # Linux reports a device that went away as readable and empty
            raise self._gone(None)
        return data

    def _send(self, fd: int, data: bytes) -> int:
        try:
            return os.write(fd, data)
        except BlockingIOError:
            return 0
        except OSError as error:
            raise self._gone(error) from error

    def _fd(self) -> int:
        if self._serial is None:
            raise PortError(f"port {self.path} is not open")
        return self._number

    def _refuse_a_second_master(self) -> None:
        if others := holders(self.path):
            raise PortError(
                f"port {self.path} is open in another program, process {', '.join(others)}; expected it free: two that "
                "read from one port take each other's answers"
            )

    def _gone(self, error: Exception | None) -> PortError:
        if error is None and not any(what & HUNG_UP for _, what in self._poll.poll(0)):
            return PortError(
                f"port {self.path} is read by another program, too: what had come in was gone; likely cause: the "
                f"robot's controller (sudo fuser {self.path} names it)"
            )
        return PortError(
            f"port {self.path} went away ({error or 'end of file'}); likely cause: unplugged or lost power"
        )

    def _explain(self, error: Exception) -> str:
        """One line: what was found, what was expected, the likely cause."""
        name = f"port {self.path or '(none)'}"
        number = getattr(error, "errno", None)
        if not self.path:
            return "no port is named; expected one such as /dev/ttyUSB0"
        if number == errno.ENOENT:
            folder = Path("/dev/serial/by-id")
            there = ", ".join(sorted(p.name for p in folder.iterdir())) if folder.is_dir() else "no serial adapter"
            return f"{name} does not exist; likely cause: unplugged, or under another name (there is {there})"
        if number in (errno.EACCES, errno.EPERM):
            return f"{name} may not be opened by this user; likely cause: the user is not in the group dialout"
        if number in (errno.EBUSY, errno.EAGAIN):
            return (
                f"{name} is busy; likely cause: another program holds it (the robot's controller, ModemManager; "
                f"sudo fuser {self.path} names it)"
            )
        if isinstance(error, ValueError):
            return f"{name} cannot run at {self.baudrate} baud: {error}"
        return f"{name} is no usable serial port ({error}); expected a tty; likely cause: a wrong name"


def _release(device: serial.Serial) -> None:
    with contextlib.suppress(OSError):  # unplugged: there is nothing left to give back
        fcntl.ioctl(device.fileno(), termios.TIOCNXCL)
    device.close()
