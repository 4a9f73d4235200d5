"""Bounds that hold for every value of a configuration, whatever its key means: no unit in use needs a number beyond
them, and with a value beyond them arithmetic, the file system or the calendar fails.

What a key's own range is stands with its type (``options.py``) or in ``crosscheck.py``.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from datetime import datetime

from lostmotion.drivers.errors import LostmotionError

__all__ = ["MOST_TEXT", "BoundsError", "check"]

SMALLEST, LARGEST = 1e-12, 1e12
MOST_TEXT = 4096
"""characters; so many bytes a path may have on Linux"""
YEARS = (1970, 2500)


class BoundsError(LostmotionError):
    """A value that no configuration needs; the message names its key."""


def check(value: object, path: str, name: Callable[[str, int, object], str]) -> None:
    """Raises BoundsError at the first value beyond the bounds.

    path: where the value stands; name: the path of item ``index`` of the list at a path.  How deep values may be nested
    was checked when they were parsed.
    """
    if isinstance(value, dict):
        for key, inner in value.items():
            check(inner, f"{path}.{key}" if path else key, name)
    elif isinstance(value, list):
        for index, inner in enumerate(value):
            check(inner, name(path, index, inner), name)
    elif (expected := _expected(value)) is not None:
        shown = f"{value!r:.40}" if isinstance(value, str) else value
        raise BoundsError(f"{path}: found {shown}, expected {expected}")


def _expected(value: object) -> str | None:
    """What was expected instead of a value, None where it is within the bounds."""
    if isinstance(value, float) and not math.isfinite(value):
        return "a finite number"
    if isinstance(value, int | float) and value and not SMALLEST <= abs(value) <= LARGEST:
        return f"0, or a number between {SMALLEST:g} and {LARGEST:g}"
    if isinstance(value, str) and (len(value) > MOST_TEXT or "\0" in value):
        return f"a text of at most {MOST_TEXT} characters without NUL"
    if isinstance(value, datetime) and not YEARS[0] <= value.year <= YEARS[1]:
        return f"a time between the years {YEARS[0]} and {YEARS[1]}"
    return None
