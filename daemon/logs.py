"""Where the service's log goes: to standard error for a person, with a time; to journald with a priority and fields.

Fields come with a record as ``extra={"fields": {...}}``; journald gets them as LOSTMOTION_… beside its usual ones.
"""

from __future__ import annotations

import io
import logging
import os
import select
import socket
import struct
import sys
import time
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import TextIO

from lostmotion.drivers.terminal import printable

__all__ = ["setup"]

PRIORITY = {logging.CRITICAL: 2, logging.ERROR: 3, logging.WARNING: 4, logging.INFO: 6, logging.DEBUG: 7}
"""sd-daemon(3); other levels count as the next lower one"""
JOURNAL = Path("/run/systemd/journal/socket")
PATIENCE_S = 1.0
"""how long a line waits for a reader that takes nothing, such as a journald on a failing disk, or a pipe whose reader
is stopped [s]; those after it do not wait"""


def setup(environment: Mapping[str, str] = os.environ, journal: Path = JOURNAL) -> None:
    """Sends the log of all of lostmotion to standard error, instead of where it went before; under systemd to the
    socket ``journal``, where it is there."""
    handler: logging.Handler = StderrHandler(sys.stderr)
    if "JOURNAL_STREAM" in environment and journal.is_socket():
        handler = JournalHandler(journal)
    elif "JOURNAL_STREAM" in environment or "INVOCATION_ID" in environment:
        handler.setFormatter(PriorityFormatter("%(message)s"))
    else:
        handler.setFormatter(TimeFormatter("%(asctime)s %(levelname)-7s %(message)s"))
    logger = logging.getLogger()
    logger.handlers[:] = [handler]
    logger.setLevel(logging.INFO)


class OneLineHandler(logging.Handler):
    """What keeps a record from being written, such as lack of memory, is a line and no traceback, or nothing at all;
    the caller goes on."""

    def handleError(self, record: logging.LogRecord) -> None:  # noqa: N802 - logging's name
        with suppress(Exception):
            sys.stderr.write(f"a line of the log is missing: {sys.exc_info()[1]!r}\n")


class PatientHandler(OneLineHandler):
    """A reader that hangs costs lines, which are counted, and not the service that writes them."""

    reader = ""

    def __init__(self) -> None:
        super().__init__()
        self._missing = 0

    def emit(self, record: logging.LogRecord) -> None:
        try:
            self._deliver(record, 0.0 if self._missing else PATIENCE_S)
        except (TimeoutError, BlockingIOError):
            self._missing += 1
        except Exception:  # noqa: BLE001 - as logging's own handlers
            self.handleError(record)
        else:
            with suppress(Exception):  # the next line tries again
                self._tell_missing()

    def _deliver(self, record: logging.LogRecord, seconds: float) -> None:
        """Writes the record.  Raises TimeoutError or BlockingIOError if the reader takes nothing for that time."""
        raise NotImplementedError

    def _tell_missing(self) -> None:
        if not self._missing:
            return
        line = f"{self._missing} lines of the log are missing here: {self.reader} took none for a time"
        record = logging.makeLogRecord(
            {"name": __name__, "levelno": logging.WARNING, "levelname": "WARNING", "msg": line}
        )
        self._deliver(record, 0.0)
        self._missing = 0


class StderrHandler(PatientHandler):
    """Lines on standard error."""

    reader = "the reader of standard error"

    def __init__(self, stream: TextIO) -> None:
        super().__init__()
        self._stream = stream
        self._rest = b""
        """of a line that is begun"""
        try:
            self._descriptor: int | None = _that_does_not_wait(stream.fileno())
        except io.UnsupportedOperation:  # no file, but memory of this process
            self._descriptor = None

    def _deliver(self, record: logging.LogRecord, seconds: float) -> None:
        line = self.format(record) + "\n"
        if self._descriptor is None:
            self._stream.write(line)
            self._stream.flush()
            return
        self._write_rest(self._descriptor, seconds)
        data = line.encode(self._stream.encoding, "backslashreplace")
        self._rest = data[_write_some(self._descriptor, data, seconds) :]
        with suppress(TimeoutError, BlockingIOError):
            self._write_rest(self._descriptor, seconds)

    def _write_rest(self, descriptor: int, seconds: float) -> None:
        while self._rest:
            self._rest = self._rest[_write_some(descriptor, self._rest, seconds) :]


class TimeFormatter(logging.Formatter):
    """Times in UTC, ISO 8601, and no control characters, which a terminal would obey."""

    converter = staticmethod(time.gmtime)
    default_time_format = "%Y-%m-%dT%H:%M:%S"
    default_msec_format = "%s.%03dZ"

    def format(self, record: logging.LogRecord) -> str:
        return printable(super().format(record))


class PriorityFormatter(logging.Formatter):
    """Puts ``<n>`` before every line; journald adds the time itself."""

    def format(self, record: logging.LogRecord) -> str:
        return "\n".join(f"<{_priority(record)}>{line}" for line in super().format(record).splitlines())


class JournalHandler(PatientHandler):
    """Speaks journald's own protocol (systemd.io/JOURNAL_NATIVE_PROTOCOL): one datagram a record.

    In place of systemd-python, which needs a compiler and systemd's headers to be installed.
    """

    reader = "journald"

    def __init__(self, journal: Path) -> None:
        super().__init__()
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC)
        self._journal = str(journal)
        self._stderr = StderrHandler(sys.stderr)
        self._stderr.setFormatter(PriorityFormatter("%(message)s"))

    def _deliver(self, record: logging.LogRecord, seconds: float) -> None:
        self._socket.settimeout(seconds)
        try:
            self._socket.sendto(self._datagram(record), self._journal)
        except (TimeoutError, BlockingIOError):
            raise
        except OSError:  # journald restarts, or the record is too long for a datagram
            self._stderr.handle(record)

    def _datagram(self, record: logging.LogRecord) -> bytes:
        fields = {
            "MESSAGE": self.format(record),
            "PRIORITY": _priority(record),
            "SYSLOG_IDENTIFIER": "lostmotion",
            "CODE_FUNC": f"{record.name}.{record.funcName}",
        }
        own: Mapping[str, object] = getattr(record, "fields", {})
        fields |= {f"LOSTMOTION_{name.upper()}": value for name, value in own.items()}
        return b"".join(_field(name, str(value)) for name, value in fields.items())

    def close(self) -> None:
        self._socket.close()
        super().close()


def _that_does_not_wait(descriptor: int) -> int:
    """A terminal, opened once more: one that is ready may take a part of a line and wait with the rest.  For others who
    have it open nothing changes.  Another file as it is."""
    if not os.isatty(descriptor):
        return descriptor
    try:
        return os.open(os.ttyname(descriptor), os.O_WRONLY | os.O_NONBLOCK | os.O_NOCTTY | os.O_CLOEXEC)
    except OSError:  # another user's
        return descriptor


def _write_some(descriptor: int, data: bytes, seconds: float) -> int:
    """Writes the begin of the data; the number of bytes.  Raises TimeoutError if there is no room within that time.

    A pipe that is ready takes ``PIPE_BUF`` bytes without waiting, however little it holds.
    """
    room = select.poll()
    room.register(descriptor, select.POLLOUT)
    if not room.poll(1000 * seconds):
        raise TimeoutError
    return os.write(descriptor, data[: select.PIPE_BUF])


def _priority(record: logging.LogRecord) -> int:
    return PRIORITY[max((known for known in PRIORITY if known <= record.levelno), default=logging.DEBUG)]


def _field(name: str, value: str) -> bytes:
    """NAME=value, or with its length where it has several lines."""
    data = value.encode(errors="replace")
    if b"\n" in data:
        return name.encode() + b"\n" + struct.pack("<Q", len(data)) + data + b"\n"
    return name.encode() + b"=" + data + b"\n"
