"""A primitive that wakes a waiting thread.  It carries no data."""

from __future__ import annotations

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
        try:  # noqa: SIM105 - a third of the time that contextlib takes
            self._asleep.release()
        except RuntimeError:  # it has been done already
            pass

    def wait(self, timeout_s: float) -> bool:
        """Whether it was woken within so long."""
        return self._asleep.acquire(timeout=timeout_s)
