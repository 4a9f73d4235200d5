"""Signals that have times of their own, as the structures have that Simulink saves ("Structure With Time"): on the
clock of the longest."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lostmotion.drivers.base import FloatArray
from lostmotion.drivers.formats.guess import listed
from lostmotion.drivers.formats.source import Series

__all__ = ["CLOCK", "on_one_clock"]

CLOCK = "time"
"""the last part of the name of a signal's times, and the name of those of all"""

Vectors = Mapping[str, NDArray[Any]]


def on_one_clock(vectors: Vectors) -> tuple[Vectors, Sequence[str]]:
    """Vectors by name, those of structures with times on the one ``time`` of the longest of these; what was sampled at
    other times holds its last value, as an input does.  And what a person should know of it."""
    clocks = {name.removesuffix(f".{CLOCK}"): values for name, values in vectors.items() if _is_clock(name, values)}
    if not clocks or CLOCK in vectors:
        return vectors, []
    time = max(clocks.values(), key=lambda values: values.size)
    found: dict[str, NDArray[Any]] = {CLOCK: time}
    held = []
    for name, values in vectors.items():
        own = _clock_of(name, clocks)
        if own is None or own.size != values.size:
            found[name] = values
        elif not name.endswith(f".{CLOCK}"):
            plain = name.replace(".signals.values", "")
            is_same = own.size == time.size and bool(np.abs(own - time).max() < np.median(np.diff(time)) / 2)
            found[plain] = values if is_same else _held(values, own, time)
            held += [] if is_same else [plain]
    names = listed([Series(name) for name in held])
    return found, [f"{names}: sampled at other times; each value is held until the next one"] if held else []


def _is_clock(name: str, values: NDArray[Any]) -> bool:
    return name.endswith(f".{CLOCK}") and bool(np.isfinite(values).all() and (np.diff(values.astype(float)) >= 0).all())


def _clock_of(name: str, clocks: Vectors) -> NDArray[Any] | None:
    """The times of the innermost structure that holds a signal."""
    around = [prefix for prefix in clocks if name.startswith(f"{prefix}.")]
    return clocks[max(around, key=len)] if around else None


def _held(values: NDArray[Any], own: NDArray[Any], time: NDArray[Any]) -> FloatArray:
    """The last value at each of these times, none before the first."""
    at = np.searchsorted(own, time, side="right") - 1
    return np.where(at < 0, np.nan, values.astype(float)[np.maximum(at, 0)])
