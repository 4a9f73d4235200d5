"""What wakes a thread that waits for file descriptors, such as that of a bus; ``daemon/waker.py`` is for one that waits
for nothing else."""

from __future__ import annotations

import os
import select
import weakref

__all__ = ["Wakeup"]


class Wakeup:
    """Wakes one thread that waits, once, from any other; never blocks."""

    def __init__(self) -> None:
        self._event = os.eventfd(0, os.EFD_CLOEXEC | os.EFD_NONBLOCK)
        weakref.finalize(self, os.close, self._event)  # who wakes it late must not write into another file

    def wake(self) -> None:
        """Ends a wait, also the next one if none is waiting now."""
        os.eventfd_write(self._event, 1)

    def wait(self, seconds: float, *others: int) -> bool:
        """Returns when it is woken, when another descriptor is readable or broken, or after so many seconds; whether
        another is."""
        poll = select.poll()
        for descriptor in (self._event, *others):
            poll.register(descriptor, select.POLLIN)
        ready = {descriptor for descriptor, _ in poll.poll(max(seconds, 0.0) * 1000)}
        if self._event in ready:
            os.eventfd_read(self._event)
        return bool(ready - {self._event})
