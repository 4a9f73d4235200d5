"""Until when a search may work.  Fits and searches ask here, and end with the best that they have.

The time belongs to the context (contextvars) of whoever began the search, and goes along into the threads and processes
of the lab's executors, so that no function between the two has to pass it on.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import ParamSpec, TypeVar

__all__ = ["bounded", "is_over", "remaining_s", "within"]

P = ParamSpec("P")
R = TypeVar("R")
_UNTIL: ContextVar[float] = ContextVar("until", default=math.inf)
"""Of time.monotonic() [s]."""


@contextmanager
def within(seconds: float) -> Iterator[None]:
    """In the block, searches end after so many seconds; a block inside of another one has a time of its own."""
    token = _UNTIL.set(time.monotonic() + seconds)
    try:
        yield
    finally:
        _UNTIL.reset(token)


def remaining_s() -> float:
    """Seconds that are left, negative when it is over; infinite outside of such a block."""
    return _UNTIL.get() - time.monotonic()


def is_over() -> bool:
    """Whether the time is up."""
    return remaining_s() < 0


def bounded(seconds: float, function: Callable[P, R], *args: P.args, **kwargs: P.kwargs) -> R:
    """The function's result, called within so many seconds: what another process is asked for."""
    with within(seconds):
        return function(*args, **kwargs)
