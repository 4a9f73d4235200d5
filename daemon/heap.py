"""The heap of the C library: that a service gives back to the system what it no longer needs.  glibc only."""

from __future__ import annotations

import ctypes
from contextlib import suppress

__all__ = ["give_back", "set_up"]

ARENA_MAX, MMAP_THRESHOLD, TRIM_THRESHOLD = -8, -3, -1
"""M_ARENA_MAX, M_MMAP_THRESHOLD and M_TRIM_THRESHOLD of mallopt(3)"""
LARGE, KEPT = 1024 * 1024, 4 * 1024 * 1024
"""Arrays from the first size on are given back when they are freed, and the end of the heap from the second on [bytes].
With the C library's own 128 kB, six joints on one sensor made 460 and 2000 page faults a second in the first minute,
and 26 and 53 with these; the service took 69.9 and 77.4 MB, and 69.5 and 70.1 (two pairs side by side)."""


def set_up() -> None:
    """The C library keeps no heap for each thread, and gives large arrays back to the system when they are freed.

    A service with all sinks has 15 threads, which hardly ever run at the same time, and takes 1.5 MB less (of 76, after
    50 s).  The sizes of play and the comparison of joints need arrays of some megabytes for a moment: two servos and a
    sensor of 1 kHz take 65 MB instead of 70 after 35 s.
    """
    with suppress(AttributeError):  # another C library than glibc
        library = ctypes.CDLL(None)
        library.mallopt(ARENA_MAX, 1)
        library.mallopt(MMAP_THRESHOLD, LARGE)
        library.mallopt(TRIM_THRESHOLD, KEPT)


def give_back() -> None:
    """Gives the pages between what is in use back to the system: 3 MB of those two servos' 63, in half a millisecond,
    of what smaller arrays have left behind since the last call."""
    with suppress(AttributeError):
        ctypes.CDLL(None).malloc_trim(0)
