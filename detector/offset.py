"""An accelerometer's readings without motion, offset and gravity, estimated from many windows.  No ring, no play.

A tangential accelerometer on a joint at the angle theta reads l theta'' + o + A sin theta + B cos theta, where o is its
offset and A, B are what gravity has along its axis, at most 9.8 m/s².  Twice integrated, an offset that is 0.1 m/s²
wrong on a lever of 0.1 m is a parabola that reaches 25 mrad after 0.45 s: more than most plays.  One window gives
little information,

    r = integral of w (a - l theta_1'') dt = o + gravity + l * integral of w'' D dt,    D = theta_2 - theta_1,

but D is bounded by the play, so with a smooth weight w (Hann) its part of r is small, and many windows determine o, A
and B by least squares.  Other joints that turn the sensor scatter r; the estimate's variance grows with the scatter.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from lostmotion.detector.window import FloatArray

__all__ = ["OFFSET_UNKNOWN", "OWN", "OffsetLaw", "averaged"]

OWN, OWN_COUNT = 0.1, 3.0
"""Standard deviation of r that play alone makes [m/s²]: 0.03 to 0.14 in recordings with plays of 5 to 53 mrad (nine
joints of ``bench.outside``), 0.04 to 0.45 with a plain mean instead of Hann's weight; and its weight in windows."""
LARGEST = 10.0
"""Standard deviation of o, A and B before the first window [m/s²]."""
LEAST = 0.02
"""Change of an offset from window to window [m/s²]: 2 mg."""
MEMORY = 0.97
"""Weight of earlier windows after each window: an arm is set up otherwise, a sensor warms up."""


@dataclass(frozen=True, slots=True)
class OffsetLaw:
    """Sums over a joint's windows so far, with f = (1, sin theta, cos theta): products f f (9 values), moments f r,
    squares r², and their number."""

    products: tuple[float, ...] = (0.0,) * 9
    moments: tuple[float, ...] = (0.0,) * 3
    squares: float = 0.0
    windows: float = 0.0

    def updated(self, angle: float, reading: float) -> OffsetLaw:
        """The law after one more window, which read r [m/s²] around that angle [rad]."""
        row = _row(np.array(angle))
        products = MEMORY * np.array(self.products) + np.outer(row, row).ravel()
        moments = MEMORY * np.array(self.moments) + row * reading
        return OffsetLaw(tuple(products.tolist()), tuple(moments.tolist()),
                         MEMORY * self.squares + reading**2, MEMORY * self.windows + 1)  # fmt: skip

    def read(self, angles: FloatArray) -> tuple[FloatArray, float, float]:
        """The reading without motion at the angles [m/s²], (N,), with the standard deviations at their middle [m/s²]
        and of its slope [m/s² per rad].

        Other joints that turn the sensor by some radians change the slope by as much as the reading.
        """
        products, moments = np.array(self.products).reshape(3, 3), np.array(self.moments)
        spread, values, covariance = OWN, np.zeros(3), np.eye(3) * LARGEST**2
        for _ in range(2):
            covariance = np.asarray(np.linalg.inv(products / spread**2 + np.eye(3) / LARGEST**2), np.float64)
            values = covariance @ moments / spread**2
            left = max(self.squares - 2 * values @ moments + values @ products @ values, 0.0)
            spread = math.sqrt((left + OWN_COUNT * OWN**2) / (self.windows + OWN_COUNT))
        middle = _row(np.array(angles.mean()))
        slope = np.array([0.0, middle[2], -middle[1]])
        scatter = math.hypot(spread, LEAST)
        return (_row(angles) @ values, math.sqrt(middle @ covariance @ middle + scatter**2),
                math.sqrt(slope @ covariance @ slope + scatter**2))  # fmt: skip


OFFSET_UNKNOWN = OffsetLaw()


def averaged(values: FloatArray) -> float:
    """Mean weighted by a Hann window, whose value and slope are 0 at both ends."""
    weight = np.hanning(values.size + 2)[1:-1]
    return float(weight @ values / weight.sum())


def _row(angle: FloatArray) -> FloatArray:
    return np.stack([np.ones_like(angle), np.sin(angle), np.cos(angle)], axis=-1)
