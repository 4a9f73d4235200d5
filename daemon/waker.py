"""A primitive that wakes a waiting thread.  It carries no data."""

from __future__ import annotations

import contextlib
import threading

__all__ = ["Waker"]


class Waker:
    """Wakes one thread that waits, once, from any other; a thread that was woken before it waits does not wait.

    It is a bare lock, for a ``threading.Event`` runs a hundred lines of Python when one wakes: tens of times a second.
    """

    def __init__(self) -> None:
        self._asleep = threading.Lock()
        self._asleep.acquire()

    def wake(self) -> None:
        """Wakes the waiting thread."""
        with contextlib.suppress(RuntimeError):  # it has been done already
            self._asleep.release()

    def wait(self, timeout_s: float) -> bool:
        """Whether it was woken within so long."""
        return self._asleep.acquire(timeout=timeout_s)
