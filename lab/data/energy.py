"""Whether a motion that nothing is known to drive gains energy, which no free one does, or loses none, as one does."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from lostmotion.model.motion import FloatArray

__all__ = ["energy_gain", "energy_loss", "gains_energy", "loses_none"]

GAIN = 0.3
"""Share of the largest squared speed, above which a motion is driven.  Of 84 published recordings of parts that swing
freely the largest is 0.10, by the noise of their speed, and of 108 simulated short ones with much noise 0.21.  Of 16 of
a servo that follows sines all along 15 have 0.37 to 0.66 and one has 0.06; of 25 others that are driven 8 have 0.33 to
0.999, two 0.24 to 0.3, and the rest pass few places twice."""
PLACES = np.linspace(0.1, 0.9, 9)
"""shares of the readings that are below the places that are looked at"""

PASSAGES = 8
"""of a place, from which on a loss is looked for: in four periods"""
LOSS = 1.0
"""Standard errors, below which no energy is lost.  Of fifteen published recordings of pendulums the least is 1.9; of a
piston that is pushed to and fro at one speed it is 0.6, of a motor's shaft under a sine 0.0.  Of twenty simulated
pendulums each that are filmed for 5 to 30 periods it is 2.3 to 11 with a quality of 50 and 200 and little noise, below
one in a tenth of those with 1000, and in most with 5000, which show no damping."""

SURE_LOSS = 3.0
"""Standard errors, above which a motion is free although its energy grows for a while, as that of a pendulum does whose
support yields, or which swings in another plane, too (gains of 0.35 and 0.69 on two films).  These lose 7.7 and 4.2.
Of 23 recordings of driven joints that pass a place eight times the largest is 1.5."""


def gains_energy(gain: float, loss: float) -> bool:
    """Whether a motion with this gain and this loss is driven."""
    return gain > GAIN and not SURE_LOSS < loss < math.inf


def loses_none(loss: float) -> bool:
    """Whether a motion loses no more energy than a driven one."""
    return loss < LOSS


def energy_gain(position: FloatArray, velocity: FloatArray) -> float:
    """How much the squared speed (N,) grows at most from one passage of a place (N,) to a later one, as a share of the
    largest squared speed: the median of nine places; 0.0 where no place is passed twice.

    A weight or a spring gives back at a place what it has taken since, and friction only takes.
    """
    passed = [each for each in _passages(position, velocity) if each.size > 1]
    gains = [float((each[1:] - np.minimum.accumulate(each)[:-1]).max()) for each in passed]
    most = float((velocity**2).max(initial=0.0))
    return max(float(np.median(gains)) / most, 0.0) if gains and most else 0.0


def energy_loss(position: FloatArray, velocity: FloatArray) -> tuple[float, int]:
    """By how many of its standard errors the mean squared speed (N,) at a place (N,) is smaller in the second half of
    the passages than in the first: the median of nine places, and of the number of passages; infinite and 0 where none
    is passed often enough."""
    passed = [each for each in _passages(position, velocity) if each.size >= PASSAGES]
    if not passed:
        return math.inf, 0
    losses = []
    for each in passed:
        early, late = np.array_split(each, 2)
        error = math.hypot(*(np.std(half, ddof=1) / math.sqrt(half.size) for half in (early, late)))
        losses.append(float(early.mean() - late.mean()) / max(error, 1e-300))
    return float(np.median(losses)), int(np.median([each.size for each in passed]))


def _passages(position: FloatArray, velocity: FloatArray) -> Iterator[FloatArray]:
    """The squared speeds (K,) at the passages of each place, in turn."""
    power = velocity**2
    for place in np.quantile(position, PLACES):
        before = np.flatnonzero((position[1:] - place) * (position[:-1] - place) < 0)
        yield (power[before] + power[before + 1]) / 2
