"""Whether a motion that nothing is known to drive gains energy, which no free one does."""

from __future__ import annotations

import numpy as np

from lostmotion.model.motion import FloatArray

__all__ = ["GAIN", "energy_gain"]

GAIN = 0.3
"""Share of the largest squared speed, above which a motion is driven.  Of 84 published recordings of parts that swing
freely the largest is 0.10, by the noise of their speed, and of 108 simulated short ones with much noise 0.21.  Of 16 of
a servo that follows sines all along 15 have 0.37 to 0.66 and one has 0.06; of 25 others that are driven 8 have 0.33 to
0.999, two 0.24 to 0.3, and the rest pass few places twice."""
PLACES = np.linspace(0.1, 0.9, 9)
"""shares of the readings that are below the places that are looked at"""


def energy_gain(position: FloatArray, velocity: FloatArray) -> float:
    """How much the squared speed (N,) grows at most from one passage of a place (N,) to a later one, as a share of the
    largest squared speed: the median of nine places; 0.0 where no place is passed twice.

    A weight or a spring gives back at a place what it has taken since, and friction only takes.
    """
    power = velocity**2
    gains = []
    for place in np.quantile(position, PLACES):
        before = np.flatnonzero((position[1:] - place) * (position[:-1] - place) < 0)
        passed = (power[before] + power[before + 1]) / 2
        if passed.size > 1:
            gains.append(float((passed[1:] - np.minimum.accumulate(passed)[:-1]).max()))
    most = float(power.max(initial=0.0))
    return max(float(np.median(gains)) / most, 0.0) if gains and most else 0.0
