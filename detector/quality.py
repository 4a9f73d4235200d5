"""Defects of a window: words for the ``quality`` of a score."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from lostmotion.detector.window import GENTLE, FloatArray, Window

__all__ = ["IMPLAUSIBLE", "LEAST_SHARE", "OK", "describe", "mended", "scoreless"]

OK = "ok"
IMPLAUSIBLE = "implausible"
LEAST_SHARE = 0.8
"""A window with fewer of its samples than this is not scored."""
GAPPY_SHARE = 0.98
COVERED_SHARE = 0.95
FULL_SCALE = 0.999
FLAT_TOP = 3


def describe(window: Window, range_ms2: float = math.inf, gentle: float = GENTLE) -> str:
    """ "ok", or comma-separated: short, gappy, clipped, flat, gentle.

    short: the samples start late or end early; gappy: samples are missing in between; clipped: at the sensor's range
    (range_ms2 [m/s²]) or with a flat top; flat: no signal at all; gentle: excited by less than ``gentle`` [rad/s²], so
    a low score is no evidence.
    """
    values = window.accel
    covered = values.size
    if covered and not math.isfinite(values.sum()):
        there = np.flatnonzero(np.isfinite(values))
        values = values[there]
        covered = int(there[-1] - there[0]) + 1 if there.size else 0
    if not covered:
        return "short"
    high, low = float(values.max()), float(values.min())
    flat = high == low
    found = {
        "short": covered < COVERED_SHARE * window.accel.size,
        "gappy": values.size < GAPPY_SHARE * covered,
        "clipped": max(high, -low) >= FULL_SCALE * range_ms2 or (not flat and _has_flat_top(values, (high, low))),
        "flat": flat,
        "gentle": abs(window.excitation) < gentle,
    }
    return ",".join(name for name, applies in found.items() if applies) or OK


def scoreless(quality: str) -> str:
    """The quality of a window that has no score although nothing else is wrong with it: implausible.  It is a slow
    motion without noise, such as a clock's column, or its squares overflow."""
    return {OK: IMPLAUSIBLE, "gentle": f"{IMPLAUSIBLE},gentle"}.get(quality, quality)


def mended(accel: FloatArray) -> FloatArray:
    """The window with missing samples interpolated linearly; shape (N,) with at least one sample."""
    there = np.isfinite(accel)
    if there.all():
        return accel
    index = np.arange(accel.size)
    return np.interp(index, index[there], accel[there])


def _has_flat_top(values: FloatArray, extremes: tuple[float, float]) -> bool:
    """Whether the signal stays at an extreme for some samples after a step far larger than its finest.

    A slow signal in coarse steps also stays at its top for a while, but reaches it by its finest step.
    """
    held = [values == extreme for extreme in extremes]
    return any(np.count_nonzero(at) >= FLAT_TOP and _is_jumped_to(at, values) for at in held)


def _is_jumped_to(at: NDArray[np.bool_], values: FloatArray) -> bool:
    """Whether a large step leads to one of the longer segments where ``at`` is true."""
    steps = np.abs(np.diff(values))
    finest = float(steps[steps > 0].min())
    edges = np.flatnonzero(np.diff(np.concatenate(([0], at.astype(np.int8), [0]))))
    segments = zip(edges[::2], edges[1::2], strict=True)
    return any(end - first >= FLAT_TOP and first > 0 and steps[first - 1] > 5 * finest for first, end in segments)
