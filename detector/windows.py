"""Windows of tip acceleration after reversals: their length, and cutting them from a stream."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import lru_cache

import numpy as np

from lostmotion.detector.window import DetectorSettings, FloatArray, Window

__all__ = ["cut", "last_part", "window_length"]

BEST_RATIO = 1.2564
"""T / tau that maximises (1 - exp(-T / tau)) / sqrt(T), a ring-down's amplitude over white noise in T seconds."""
IMPACT_DELAY = 0.05
"""Typical time from a reversal to the impact [s]; the gap has to be crossed first."""
LONGEST = 0.5
"""The usual time between reversals of a hand-waved arm [s]: a longer window would contain the next impact."""
LEAST_RESOLUTION = 2.5
"""Least bins in the mask for a ring to be detected."""


def window_length(settings: DetectorSettings, rate_hz: float) -> float:
    """Length of a window [s], a whole number of samples.

    That of the settings, or else, for the oscillator: the delay of the impact and 1.26 time constants tau = 1 / (2π
    zeta f_res) of its ring-down, at least 2.5 / f_width, at most 0.5 s.  A longer window gathers more noise than ring;
    docs/decisions/0002-score.md has the measurement.
    """
    if settings.window_s is not None:
        wanted = settings.window_s
    else:
        tau = 1 / (2 * math.pi * settings.zeta * settings.f_res_hz)
        shortest = LEAST_RESOLUTION / settings.f_width_hz
        wanted = max(shortest, min(IMPACT_DELAY + BEST_RATIO * tau, LONGEST))
    return max(round(wanted * rate_hz), 1) / rate_hz


def cut(
    joint: str,
    times: FloatArray,
    accel: FloatArray,
    start: float,
    duration: float,
    rate_hz: float,
    excitation: float = math.nan,
    temperature: float = math.nan,
) -> Window:
    """The window [start, start + duration) of a stream of tip acceleration, on the grid of the sensor's rate.

    times [s], ascending, and accel [m/s²], shape (M,): a segment of the stream with the window, or its available part.
    Each sample goes to the grid point nearest in time, whatever its jitter; a grid point without a sample is NaN.  The
    grid starts within half a sample of ``start``.
    """
    length = round(duration * rate_hz)
    first, last = times.searchsorted((start - 1 / rate_hz, start + duration + 1 / rate_hz))
    place = (times[first:last] - start) * rate_hz
    # The stream's phase against the grid, averaged on the circle: one late sample must not shift all others.
    turns = 2 * math.pi * place
    phase = math.atan2(np.sin(turns).sum(), np.cos(turns).sum()) / (2 * math.pi)
    slot = np.rint(place - phase).astype(np.intp)
    begin, end = slot.searchsorted((0, length))
    grid = np.full(length, np.nan)
    grid[slot[begin:end]] = accel[first + begin : first + end]
    time = _seconds(length, rate_hz) + (start + phase / rate_hz)
    return Window(joint, start, duration, time, grid, rate_hz, excitation, temperature)


def last_part(segment: Window, duration: float) -> Window:
    """The last so many seconds of a segment, or all of it if that is shorter."""
    gone = segment.accel.size - round(duration * segment.rate_hz)
    if gone <= 0:
        return segment
    start = segment.start + gone / segment.rate_hz
    return replace(segment, start=start, duration=duration, time=segment.time[gone:], accel=segment.accel[gone:])


@lru_cache(maxsize=16)
def _seconds(length: int, rate_hz: float) -> FloatArray:
    """Times [s] of so many samples from the first one on."""
    return np.arange(length, dtype=np.float64) / rate_hz
