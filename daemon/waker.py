"""What wakes a thread that waits for another one.  Nothing is handed over here."""

from __future__ import annotations

import contextlib
import threading

__all__ = ["Waker"]


class Waker:
    """Wakes one thread that waits, once, from any other; who was woken before it waits does not wait.

    It is a bare lock, for a ``threading.Event`` runs a hundred lines of Python when one wakes: tens of times a second.
    """

    def __init__(self) -> None:
        self._asleep = threading.Lock()
        self._asleep.acquire()

    def wake(self) -> None:
        """Wakes who waits."""
        with contextlib.suppress(RuntimeError):  # it has been done already
            self._asleep.release()

    def wait(self, timeout_s: float) -> bool:
        """Whether it was woken within so long."""
        return self._asleep.acquire(timeout=timeout_s)
