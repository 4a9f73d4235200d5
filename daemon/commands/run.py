"""``lostmotion run``: the service in the foreground."""

from __future__ import annotations

import ctypes
from contextlib import suppress
from pathlib import Path

from lostmotion.daemon import config, service

__all__ = ["run"]

ARENA_MAX, MMAP_THRESHOLD = -8, -3
"""M_ARENA_MAX and M_MMAP_THRESHOLD of mallopt(3)"""
LARGE = 128 * 1024
"""The C library's own first threshold [bytes], which grows with every larger array that is freed, unless it is set."""


def run(given: Path | None, duration_s: float | None) -> int:
    """Runs until the time is over or a signal comes; the exit status is the service's."""
    _return_memory()
    if given is None:
        return service.run(config.default(), duration_s=duration_s)
    return service.run(config.load(given), duration_s=duration_s, reload=lambda: config.load(given))


def _return_memory() -> None:
    """The C library keeps no heap for each thread, and gives large arrays back to the system when they are freed.

    A service with all sinks has 15 threads, which hardly ever run at the same time, and takes 1.5 MB less (of 76, after
    50 s).  The sizes of play and the comparison of joints need arrays of some megabytes for a moment: two servos and a
    sensor of 1 kHz take 65 MB instead of 70 after 35 s.
    """
    with suppress(AttributeError):  # another C library than glibc
        library = ctypes.CDLL(None)
        library.mallopt(ARENA_MAX, 1)
        library.mallopt(MMAP_THRESHOLD, LARGE)
