"""Whether numbers go to and fro, or keep their speed, as what moves does.  Pure functions of numbers."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lostmotion.drivers.base import FloatArray

__all__ = ["SWINGS", "crossings", "drift_of", "is_smooth", "power", "swings"]

SWINGS = 6
"""Crossings of the middle, of what swings.  Of 200 random walks 17 swing with three, one with four and none with six; a
pendulum is found from its third swing on, with eight from its fourth."""
BEYOND = 0.25
"""How far beyond their middle numbers are when they have crossed it, as a share of their standard deviation.  Of
simulated swings of four periods and more with a noise of 2 % of their first amplitude 80 % are found with 0, 92 with
0.1 and all with 0.25, with one of 10 % 49, 72 and 75; with 1.0 swings that die down quickly are missed without any
noise. White and coloured noise, steps, ramps and squares are none with any of these."""
BACK = -0.5
"""Correlation of what swings with itself half a period later.  Angles and places of nine published pendulums and beams
have -0.83 to -1.00, which noise and friction of a driven one make smaller; noisy speeds of wheels, currents, and a
temperature -0.15 to 0.54, white noise 0."""
SMOOTH = 0.5
"""Correlation of the mean speeds of two neighbouring pieces of a motion, of some length: inertia keeps the speed.
Angles of seven machines have 0.68 to 1.00, a temperature 0.24, a tachometer's voltage 0.23."""
STEADY = 0.2
"""Standard deviation of the speeds of pieces of some length, as a share of their mean, up to which something turns
steadily.  Of simulated shafts whose angle has noise of the way of ten rows 45 % do with 0.1, and all with 0.2; of
random walks that drift by 0.2 of a step in each none does with 0.2, 8 % with 0.3 and 77 % with 0.5."""
PIECES = 12
"""Least number of pieces of a recording whose speeds are compared.  Of these walks 28 % keep their speed with six
pieces and none with twelve; of these shafts 28 % with 24 and all with twelve."""


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


def drift_of(times: FloatArray, position: FloatArray, speed: FloatArray) -> float:
    """The error of the speed (N,) of what swings freely, which adds up in its position (N,), the integral: how fast the
    middle of its swings moves on, as a weight or a spring pulls it to one place.  0.0 where it does not move on alike
    in either half, where it hardly swings, or where it moves on faster than it swings, as a wheel that turns with a
    ripple.

    The middle of three successive ends, the second counted twice, is that of a swing whose amplitude decays evenly.  By
    the mean speed in smooth windows six periods were needed; with 3.2 of a wheel the error is 2 % off."""
    ends = _crossed(speed)
    if ends.size < SWINGS:
        return 0.0
    place = position[ends]
    middle, when = (place[:-2] + 2 * place[1:-1] + place[2:]) / 4, times[ends][1:-1]
    half = middle.size // 2
    first, second, whole = (
        float(np.polyfit(when[part], middle[part], 1)[0]) for part in (slice(half + 1), slice(half, None), slice(None))
    )
    is_same = abs(second - first) < abs(second + first) / 2
    return whole if is_same and abs(whole) < float(np.std(speed)) else 0.0


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
