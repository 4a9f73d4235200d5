"""The service's broad catches: an error in one window, sink or poller is logged, and the rest goes on."""

from __future__ import annotations

import logging
import sqlite3
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from lostmotion.daemon import database
from lostmotion.daemon.no_memory import NO_MEMORY, is_no_memory
from lostmotion.daemon.poller import Poller
from lostmotion.daemon.repeats import Repeats, place

__all__ = ["FaultBarrier", "run_poller"]

log = logging.getLogger(__name__)

T = TypeVar("T")

PANIC = "PanicException"
"""what a library in Rust raises for a defect of its own (Zenoh): no Exception, in a module that cannot be imported"""
CRASH_PAUSE_S = 5.0
"""after how long a poller that broke down is started again [s]"""


class FaultBarrier:
    """Calls the stages of the service; each error is logged when it is new, not every time."""

    def __init__(self, database_path: Path) -> None:
        self._path = database_path
        self._errors = Repeats()

    def call(self, function: Callable[..., T], *arguments: object) -> T | None:
        """What the function returns; None where it raises an error, which is logged."""
        try:
            return function(*arguments)
        except BaseException as error:  # a defect, or what a device, a disk or a library raises
            if not isinstance(error, Exception) and type(error).__name__ != PANIC:
                raise
            self.report(str(getattr(function, "__qualname__", function)), error)
        return None

    def report(self, stage: str, error: BaseException) -> None:
        """Logs an error of a stage, unless it was logged a short time ago."""
        if isinstance(error, sqlite3.Error):  # met in reading; the store handles and logs those of the writer
            text = database.explain(self._path, error)
            if self._is_news(text):
                after = "; it stays in use until writing meets the damage, too" if database.is_damage(error) else ""
                log.error("cannot be read: %s%s", text, after)
        elif is_no_memory(error):
            if self._is_news(NO_MEMORY):
                log.error("%s; windows are lost until it is over; the service continues", NO_MEMORY)
        elif self._is_news(f"{stage}: {place(error)}"):
            log.error("internal error in %s", stage, exc_info=error)

    def _is_news(self, problem: str) -> bool:
        return self._errors.is_news(problem, time.monotonic())


def run_poller(poller: Poller, stop: threading.Event) -> None:
    """Runs a poller in its thread until ``stop``; one that breaks down is started again."""
    errors = Repeats()
    while not stop.is_set():
        try:
            poller.run()
            return
        except Exception as error:
            if is_no_memory(error):
                if errors.is_news(NO_MEMORY, time.monotonic()):
                    log.error("%s: %s; it is tried again", poller.name, NO_MEMORY)
                poller.fail(NO_MEMORY)
            else:
                if errors.is_news(place(error), time.monotonic()):
                    log.exception("%s: broke down and is started again", poller.name)
                poller.fail(f"internal error: {error!r}")
            poller.rest(CRASH_PAUSE_S)
