"""The deadline of a search, and its progress.  Fits and searches query it, and then return the best result so far.

The deadline is a context variable (contextvars) of the caller.  The lab's executors copy it into their threads and
processes, so that no function in between has to pass it on.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import ParamSpec, TypeVar

__all__ = ["FitEndsError", "Progress", "bounded", "is_over", "remaining_s", "within"]

Progress = Callable[[str, float], None]
"""Called with what a search begins to do, and the part that is done, 0 to 1."""
P = ParamSpec("P")
R = TypeVar("R")
_UNTIL: ContextVar[float] = ContextVar("until", default=math.inf)
"""The deadline, as a value of time.monotonic() [s]."""


class FitEndsError(Exception):
    """Ends a minimisation whose time is up, or whose derivatives cannot be computed."""


@contextmanager
def within(seconds: float) -> Iterator[None]:
    """In the block, searches end after so many seconds; a nested block has its own deadline."""
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
    """Calls the function with a deadline in so many seconds; process pools submit it to their workers."""
    with within(seconds):
        return function(*args, **kwargs)
