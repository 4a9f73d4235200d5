"""The log as journald gets it, heard on a real datagram socket."""

from __future__ import annotations

import logging
import os
import select
import socket
import struct
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path

import pytest

from lostmotion.daemon import logs
from lostmotion.daemon.lifecycle import raised
from lostmotion.daemon.records import Cause, Severity
from lostmotion.daemon.sinks.log import LogSink

NOON = datetime(2026, 1, 31, 12, tzinfo=UTC)


@pytest.fixture
def journal(tmp_path: Path) -> Iterator[socket.socket]:
    """journald's end of the socket, to which all logs go."""
    root = logging.getLogger()
    before, level = list(root.handlers), root.level
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as end:
        end.bind(str(tmp_path / "journal"))
        end.settimeout(60.0)
        logs.setup({"JOURNAL_STREAM": "8:1"}, tmp_path / "journal")
        yield end
    for handler in root.handlers:
        if isinstance(handler, logs.JournalHandler):
            handler.close()
    root.handlers[:] = before
    root.setLevel(level)


def fields(datagram: bytes) -> dict[str, str]:
    """The fields of one datagram, as systemd.io/JOURNAL_NATIVE_PROTOCOL writes them."""
    found = {}
    while datagram:
        line, _, rest = datagram.partition(b"\n")
        name, equals, value = line.partition(b"=")
        if not equals:
            (length,) = struct.unpack("<Q", rest[:8])
            value, rest = rest[8 : 8 + length], rest[9 + length :]
        found[name.decode()] = value.decode()
        datagram = rest
    return found


def test_an_alarm_has_fields(journal: socket.socket) -> None:
    """Its line is the message, its priority that of an error, and joint, cause and reason can be asked for alone."""
    reason = "tip: gone\nlikely cause: unplugged"
    LogSink().alarm(raised("elbow", Cause.DEVICE, Severity.ERROR, reason, NOON))
    found = fields(journal.recv(10_000))
    assert found["MESSAGE"].startswith(
        "alarm joint=elbow cause=device severity=error event=raised state=active reason="
    )
    assert (found["PRIORITY"], found["SYSLOG_IDENTIFIER"]) == ("3", "lostmotion")
    own = {name: value for name, value in found.items() if name.startswith("LOSTMOTION_")}
    assert own == {
        "LOSTMOTION_KIND": "alarm", "LOSTMOTION_JOINT": "elbow", "LOSTMOTION_CAUSE": "device",
        "LOSTMOTION_SEVERITY": "error", "LOSTMOTION_EVENT": "raised", "LOSTMOTION_STATE": "active",
        "LOSTMOTION_REASON": reason,
    }  # fmt: skip


def test_a_traceback_is_one_message(journal: socket.socket) -> None:
    """All its lines are in one record, so that no other process's lines come between."""
    try:
        raise ValueError("deep")
    except ValueError:
        logging.getLogger("lostmotion.daemon.service").exception("internal error")
    found = fields(journal.recv(10_000))
    assert found["MESSAGE"].splitlines()[0] == "internal error"
    assert found["MESSAGE"].splitlines()[-1] == "ValueError: deep"


def test_what_journald_does_not_take_goes_to_standard_error(
    journal: socket.socket, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """journald is gone for a moment: the line stands on standard error, with its priority."""
    logs.setup({"JOURNAL_STREAM": "8:1"}, tmp_path / "journal")  # with this test's standard error
    (tmp_path / "journal").unlink()
    logging.getLogger("lostmotion").warning("still here")
    assert capsys.readouterr().err == "<4>still here\n"


def test_a_journald_that_hangs_holds_nobody_up(journal: socket.socket, monkeypatch: pytest.MonkeyPatch) -> None:
    """It reads nothing: the first line too many waits for a moment, the others not at all.  Those that are missing are
    counted once it reads again."""
    monkeypatch.setattr(logs, "PATIENCE_S", 0.1)
    log = logging.getLogger("lostmotion")
    start = time.monotonic()
    for number in range(5000):
        log.warning("line %d", number)
    assert time.monotonic() - start < 30  # a line of the log takes 40 us; waiting for each would take 500 s
    journal.settimeout(0.1)
    with suppress(TimeoutError):
        taken = [0]
        while True:
            taken.append(int(fields(journal.recv(10_000))["MESSAGE"].split()[1]) + 1)
    log.warning("once more")
    assert fields(journal.recv(10_000))["MESSAGE"] == "once more"
    missing = fields(journal.recv(10_000))
    assert missing["MESSAGE"].startswith(f"{5000 - max(taken)} lines of the log are missing here")
    assert missing["PRIORITY"] == "4"


@pytest.mark.parametrize("ends", [os.pipe, os.openpty])
def test_a_reader_of_standard_error_that_hangs_holds_nobody_up(
    ends: Callable[[], tuple[int, int]], journal: socket.socket, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The same of a pipe whose reader is stopped, as in ``lostmotion run 2>&1 | less``, and of a terminal after Ctrl-S.
    A line that is begun is ended later."""
    monkeypatch.setattr(logs, "PATIENCE_S", 0.1)
    reading, writing = ends()
    with os.fdopen(reading, "rb", buffering=0) as reader, os.fdopen(writing, "w") as pipe:
        monkeypatch.setattr("sys.stderr", pipe)
        logs.setup({})
        log, start = logging.getLogger("lostmotion"), time.monotonic()
        for number in range(5000):
            log.warning("line %d", number)
        assert time.monotonic() - start < 30  # waiting for each would take 500 s
        told = b""
        while select.select([reader], [], [], 0.2)[0]:
            told += reader.read(2**20)
        log.warning("once more")
        while (
            not told.endswith(b"took none for a time" + os.linesep.encode()) and select.select([reader], [], [], 60)[0]
        ):
            told += reader.read(2**20).replace(b"\r\n", b"\n")
    *taken, once, missing = told.decode().splitlines()
    assert all(line.endswith(f"WARNING line {number}") for number, line in enumerate(taken))
    assert once.endswith("WARNING once more")
    reason = "the reader of standard error took none for a time"
    assert missing.endswith(f"WARNING {5000 - len(taken)} lines of the log are missing here: {reason}")


@pytest.mark.parametrize("environment", [{}, {"JOURNAL_STREAM": "8:1"}])
def test_a_line_that_cannot_be_written_is_no_traceback(
    journal: socket.socket, environment: dict[str, str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """What a record holds cannot be made text, as without memory: one line on standard error; the caller goes on."""

    class Starved:
        def __str__(self) -> str:
            raise MemoryError

    logs.setup(environment, tmp_path / "journal")
    logging.getLogger("lostmotion").error("%s", Starved())
    told = capsys.readouterr().err
    assert told == "a line of the log is missing: MemoryError()\n"
