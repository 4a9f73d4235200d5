"""Whether numbers go to and fro, or keep their speed, as what moves does.  Pure functions of numbers."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lostmotion.drivers.base import FloatArray

__all__ = ["SWINGS", "crossings", "is_smooth", "power", "swings"]

SWINGS = 6
"""crossings of the middle, of what swings"""
BEYOND = 0.25
"""of the standard deviation: how far beyond their middle numbers are when they have crossed it; noise about a constant,
or about the end of a step, does not"""
BACK = -0.5
"""Correlation of what swings with itself half a period later.  Angles and places of nine published pendulums and beams
have -0.83 to -1.00, which noise and friction of a driven one make smaller; noisy speeds of wheels, currents, and a
temperature -0.15 to 0.54, white noise 0."""
SMOOTH = 0.5
"""Correlation of the mean speeds of two neighbouring pieces of a motion, of some length: inertia keeps the speed.
Angles of seven machines have 0.68 to 1.00, a temperature 0.24, a tachometer's voltage 0.23."""
STEADY = 0.2
"""of the mean speed: the deviation of the speeds of pieces, of some length, of what turns steadily"""
PIECES = 12
"""of a recording: the longest of which speeds are compared"""


def swings(values: FloatArray) -> bool:
    """Whether numbers go to and fro: they cross their middle often enough, half a period later they are on its other
    side, and none of them is a jump away, as where an angle begins anew."""
    known = values[np.isfinite(values)]
    at = _crossed(known)
    if at.size < SWINGS or float(np.max(np.abs(np.diff(known)))) >= np.ptp(known) / 2:
        return False
    half = max(round(float(np.median(np.diff(at)))), 1)
    part = known[max(at[0] - half, 0) : at[-1] + half]
    return bool(np.corrcoef(part[half:], part[:-half])[0, 1] < BACK)


def crossings(values: FloatArray) -> int:
    """How often numbers cross their median."""
    return int(np.count_nonzero(np.diff(np.sign(values - np.median(values))))) if values.size else 0


def _crossed(values: FloatArray) -> NDArray[np.intp]:
    """The samples from which on numbers (N,) are on the other side of their median, by more than noise."""
    off = values - np.median(values) if values.size else values
    at = np.flatnonzero(np.abs(off) > BEYOND * np.std(off)) if values.size else np.empty(0, dtype=np.intp)
    return np.asarray(at[1:][np.diff(np.sign(off[at])) != 0])


def is_smooth(values: FloatArray) -> bool:
    """Whether the mean speeds of neighbouring pieces, of some length, are alike."""
    known = values[np.isfinite(values)]
    for length in 2 ** np.arange(int(np.log2(max(known.size // PIECES, 1))) + 1):
        speed = np.diff(known[::length])
        if np.std(speed) < STEADY * abs(np.mean(speed)):
            return True
        if min(np.ptp(speed[1:]), np.ptp(speed[:-1])) > 0 and np.corrcoef(speed[1:], speed[:-1])[0, 1] > SMOOTH:
            return True
    return False


def power(values: FloatArray) -> float:
    """The variance of those that are numbers."""
    known = values[np.isfinite(values)]
    return float(np.var(known)) if known.size else 0.0
