"""Errors of the service's stages: logged when they are new, and the rest goes on."""

from __future__ import annotations

import logging
import sqlite3
from pathlib import Path

import pytest

from lostmotion.daemon.fault_barrier import FaultBarrier
from lostmotion.daemon.no_memory import NO_MEMORY


def fails(error: BaseException) -> None:
    """A stage that cannot do its work."""
    raise error


def test_an_error_is_logged_once_with_its_traceback(caplog: pytest.LogCaptureFixture) -> None:
    """A hundred errors of one place are one line of the log, with the stage and the traceback."""
    barrier = FaultBarrier(Path("history.db"))
    assert [barrier.call(fails, ZeroDivisionError(f"try {k}")) for k in range(100)] == [None] * 100
    (record,) = caplog.records
    assert record.getMessage() == "internal error in fails"
    assert record.exc_info is not None
    assert record.exc_info[0] is ZeroDivisionError


@pytest.mark.parametrize(
    ("error", "text"),
    [(MemoryError(), NO_MEMORY), (sqlite3.OperationalError("disk I/O error"), "cannot be read: ")],
)
def test_what_users_can_mend_has_no_traceback(caplog: pytest.LogCaptureFixture, error: Exception, text: str) -> None:
    """Lack of memory and errors of the database are one line with the cause."""
    barrier = FaultBarrier(Path("history.db"))
    for _ in range(3):
        barrier.call(fails, error)
    (record,) = caplog.records
    assert record.getMessage().startswith(text)
    assert record.exc_info is None
    assert record.levelno == logging.ERROR


def test_the_result_of_a_stage_is_returned() -> None:
    """Arguments go in, the result comes out."""
    assert FaultBarrier(Path("history.db")).call(max, 3, 5) == 5


class PanicException(BaseException):
    """Named as what a library in Rust raises."""


def test_a_panic_of_a_library_is_an_error_of_its_stage(caplog: pytest.LogCaptureFixture) -> None:
    """It is no Exception, and ended the service; what the interpreter raises to end it still does."""
    barrier = FaultBarrier(Path("history.db"))
    assert barrier.call(fails, PanicException("assertion failed")) is None
    assert caplog.records[0].getMessage() == "internal error in fails"
    for error in (KeyboardInterrupt(), SystemExit()):
        with pytest.raises(type(error)):
            barrier.call(fails, error)
