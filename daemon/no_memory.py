"""Lack of memory: its message, and the errors that indicate it.  Python raises MemoryError; the system, threads and
libraries raise other errors with their own texts.
"""

from __future__ import annotations

import errno
import logging
import time
from collections.abc import Callable
from contextlib import suppress

__all__ = ["NO_MEMORY", "is_no_memory", "retry_without_memory"]

log = logging.getLogger(__name__)

NO_MEMORY = "no memory is left: another program takes it, or a limit such as the unit's MemoryMax is too low"
WORDS = ("can't start new thread", "Cannot allocate memory", "failed to map segment", "out of memory")
"""of a RuntimeError of ``threading`` (no stack for a thread), and of an ImportError of a library that finds no room"""

AGAIN_S = 1.0
"""after how long a thread that found no memory goes on [s]"""


def retry_without_memory(run: Callable[[], None], who: str) -> None:
    """Runs the function of a thread; on lack of memory logs one line, and runs it again a second later, since nothing
    restarts a thread that has ended."""
    is_logged = False
    while True:
        try:
            run()
        except Exception as error:
            if not is_no_memory(error):
                raise
            with suppress(MemoryError):
                if not is_logged:
                    log.error("%s: %s; it continues when memory is available", who, NO_MEMORY)
                    is_logged = True
            time.sleep(AGAIN_S)
        else:
            return


def is_no_memory(error: BaseException | None) -> bool:
    """Whether memory has come to an end: by the error itself, or by one that was being handled when it was raised."""
    seen = 0
    while error is not None and seen < 10:
        if isinstance(error, MemoryError) or (isinstance(error, OSError) and error.errno == errno.ENOMEM):
            return True
        if isinstance(error, RuntimeError | ImportError) and any(words in str(error) for words in WORDS):
            return True
        error, seen = error.__cause__ or error.__context__, seen + 1
    return False
