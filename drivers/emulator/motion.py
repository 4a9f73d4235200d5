"""How an emulated robot moves, and what its accelerometer feels: closed forms, tabulated once.  No physics of contact.

For the model as a robot see ``drivers/simulated.py``; this one only has to move bytes that look alike.
"""

from __future__ import annotations

import numpy as np

from lostmotion.drivers.base import FloatArray

__all__ = ["Motion"]

PERIOD_S = 20.0
"""after this the motion begins anew; all its frequencies fit"""
WAVES = ((0.85, 0.25, 0.0), (1.35, 0.15, 1.0), (2.1, 0.08, 2.5))
"""frequency [Hz], amplitude [rad], phase of the hand that waves the robot"""
RATE_HZ = 1000
LAG_S = 0.015
"""by which a servo follows its goal"""
CROSSING_S = 0.004
"""from a reversal to the impact on the other flank"""
BAR_M, F_RES_HZ, ZETA = 0.10, 58.0, 0.012
RING_MS2 = 6.0
"""amplitude of the ring-down at play 1 after the mean reversal"""
NOISE_MS2 = 0.05


class Motion:
    """A hand-waved joint and the bar behind it.

    The goal is a sum of sines; the tip feels the bar's rigid motion, noise, and, times ``play``, a ring-down
    exp(-ζωt) sin(ωt) at ω = 2π·58 Hz shortly after each reversal of the goal's acceleration, as large as the change of
    acceleration there.
    """

    def __init__(self, play: float = 1.0, seed: int = 1) -> None:
        self._time = np.arange(round(PERIOD_S * RATE_HZ)) / RATE_HZ
        self._goal = [float(angle) for angle in _waves(self._time, 0)]
        self._play = play
        self._seed = seed

    def goal(self, time: float) -> float:
        """The commanded angle [rad] at a time [s]."""
        return self._goal[int(time % PERIOD_S * RATE_HZ) % len(self._goal)]

    def position(self, time: float) -> float:
        """The measured angle [rad]: it lags a little."""
        return self.goal(time - LAG_S)

    def velocity(self, time: float) -> float:
        """The measured speed [rad/s]."""
        return (self.position(time) - self.position(time - 2 / RATE_HZ)) * RATE_HZ / 2

    def reversals(self) -> FloatArray:
        """The times [s] within one period at which the goal's acceleration changes direction."""
        accel = _waves(self._time, 2)
        at = np.flatnonzero(np.sign(accel) != np.sign(np.roll(accel, -1)))
        following = np.roll(accel, -1)[at]
        return self._time[at] - accel[at] / (following - accel[at]) / RATE_HZ

    def tip(self, rate_hz: float) -> FloatArray:
        """One period of the tip acceleration [m/s²], sampled at ``rate_hz``, shape (rate_hz × 20 s,)."""
        time = np.arange(round(PERIOD_S * rate_hz)) / rate_hz
        noise = np.random.default_rng(self._seed).normal(0, NOISE_MS2, len(time))
        return _waves(time, 2) * BAR_M + noise + self._play * self._rings(time)

    def _rings(self, time: FloatArray) -> FloatArray:
        omega = 2 * np.pi * F_RES_HZ
        reversals = self.reversals()
        jerk = np.abs(_waves(reversals, 3))
        total = np.zeros(len(time))
        for start, size in zip(reversals + CROSSING_S, jerk / jerk.mean(), strict=True):
            since = (time - start) % PERIOD_S
            ring = np.exp(-ZETA * omega * since) * np.sin(omega * since)
            total += RING_MS2 * size * np.where(since < 1.0, ring, 0.0)
        return total


def _waves(time: FloatArray, derivative: int) -> FloatArray:
    """A derivative of the goal with respect to time."""
    total = np.zeros(len(time))
    for frequency, amplitude, phase in WAVES:
        omega = 2 * np.pi * frequency
        total += amplitude * omega**derivative * np.sin(omega * time + phase + derivative * np.pi / 2)
    return total
