"""What wakes a thread that waits for another one.  Nothing is handed over here."""

from __future__ import annotations

import contextlib
import threading

__all__ = ["Bell"]


class Bell:
    """Rung by any thread, heard by one that waits, once; one that was rung before lets the next wait pass at once.

    It is a bare lock, for a ``threading.Event`` runs a hundred lines of Python when one wakes: tens of times a second.
    """

    def __init__(self) -> None:
        self._silence = threading.Lock()
        self._silence.acquire()

    def ring(self) -> None:
        """Wakes who waits."""
        with contextlib.suppress(RuntimeError):  # it has been rung already
            self._silence.release()

    def wait(self, timeout_s: float) -> bool:
        """Whether it was rung, within so long."""
        return self._silence.acquire(timeout=timeout_s)
