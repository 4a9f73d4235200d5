"""How an emulated robot moves, and what its accelerometer feels: tabulated once.  Hard stops, and eq. 7's bar.

For the model as a robot, with teeth that give and play that grows, see ``drivers/simulated.py``.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from lostmotion.drivers.base import FloatArray

__all__ = ["PLAY_RAD", "SPREAD_S", "Motion", "Taps"]

PERIOD_S = 20.0
"""after this the motion begins anew; all its frequencies fit"""
WAVES = ((0.85, 0.25, 0.0), (1.35, 0.15, 1.0), (2.1, 0.08, 2.5))
"""frequency [Hz], amplitude [rad], phase of the hand that waves the robot"""
RATE_HZ = 1000
LAG_S = 0.015
"""by which a servo follows its goal"""
SPREAD_S = 1.7
"""the servos of a line make the same motion, each this much later than the next; the last one carries the bar"""
BAR_M, F_RES_HZ, ZETA = 0.10, 58.0, 0.012
PLAY_RAD = 0.004
"""gap of the last servo at play 1: its teeth strike with 0.2 to 0.4 rad/s, which rings the bar with 10 to 20 m/s²"""
BOUNCE = 0.4
"""restitution of its teeth"""
FINE_HZ, LEAD_S = 10_000, 1.0
"""steps of the free flight a second; how long it has gone on when the table begins"""
NOISE_MS2 = 0.05


class Motion:
    """Hand-waved servos and the bar behind them.

    The goal is a sum of sines.  The driven gear of the last servo flies freely within a gap of ``play`` times PLAY_RAD
    and bounces off its ends, which follow the goal; the other servos have none.  The tip feels what all their
    accelerations, times ``levers`` [m], make of the bar (eq. 7: 58 Hz, zeta 0.012), and noise.
    """

    def __init__(self, play: float = 1.0, seed: int = 1, levers: tuple[float, ...] = (BAR_M,)) -> None:
        self._time = np.arange(round(PERIOD_S * RATE_HZ)) / RATE_HZ
        self._goal = [float(angle) for angle in _waves(self._time, 0)]
        self._play = play
        self._seed = seed
        self._levers = levers

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
        fine = np.arange(round(PERIOD_S * FINE_HZ)) / FINE_HZ
        return noise + np.interp(time, fine, _felt(self._play * PLAY_RAD, self._levers), period=PERIOD_S)


class Taps(Motion):
    """A robot that stands still while somebody flicks the bar's free end every ``every_s`` seconds, never equally hard:
    each time the bar rings freely, as eq. 7's does."""

    def __init__(self, every_s: float = 2.0, seed: int = 1) -> None:
        super().__init__(seed=seed)
        self._every = every_s

    def goal(self, time: float) -> float:
        """The commanded angle [rad]."""
        return 0.0

    def tip(self, rate_hz: float) -> FloatArray:
        """As for any motion."""
        dice = np.random.default_rng(self._seed)
        time = np.arange(round(PERIOD_S * rate_hz)) / rate_hz
        accel = dice.normal(0, NOISE_MS2, time.size)
        decay, omega = ZETA * 2 * math.pi * F_RES_HZ, 2 * math.pi * F_RES_HZ * math.sqrt(1 - ZETA**2)
        for tap in np.arange(self._every / 2, PERIOD_S, self._every):
            after = (time - tap) % PERIOD_S
            accel += dice.uniform(8.0, 20.0) * np.exp(-decay * after) * np.sin(omega * after)
        return accel


@lru_cache(maxsize=4)
def _felt(gap: float, levers: tuple[float, ...]) -> FloatArray:
    """One period of the tip acceleration [m/s²] without noise, FINE_HZ a second: eq. 7 in the frequency domain."""
    fine = np.arange(round(PERIOD_S * FINE_HZ)) / FINE_HZ
    last = len(levers) - 1
    driven = levers[last] * (_driven(gap) if gap else _waves(fine, 2))
    for i, lever in enumerate(levers[:last]):
        driven = driven + lever * _waves(fine + SPREAD_S * (last - i), 2)
    turn, omega = 2j * math.pi * np.fft.rfftfreq(fine.size, 1 / FINE_HZ), 2 * math.pi * F_RES_HZ
    damped = 2 * ZETA * omega * turn + omega**2
    return np.fft.irfft(np.fft.rfft(driven) * damped / (turn**2 + damped), fine.size)


def _driven(gap: float) -> FloatArray:
    """One period of the acceleration [rad/s²] of a gear that flies freely between stops ``gap`` [rad] apart."""
    lead = round(LEAD_S * FINE_HZ)
    time = np.arange(-lead, round(PERIOD_S * FINE_HZ)) / FINE_HZ
    impulses = np.zeros(time.size)
    stops, drifts = _waves(time, 0).tolist(), _waves(time, 1).tolist()
    place, speed = stops[0], drifts[0]
    for i, (stop, drift) in enumerate(zip(stops, drifts, strict=True)):
        place += speed / FINE_HZ
        beyond = place - stop
        if abs(beyond) > gap / 2 and beyond * (speed - drift) > 0:
            place, impulses[i] = stop + math.copysign(gap / 2, beyond), (1 + BOUNCE) * (drift - speed)
            speed += impulses[i]
    return impulses[lead:] * FINE_HZ


def _waves(time: FloatArray, derivative: int) -> FloatArray:
    """A derivative of the goal with respect to time."""
    total = np.zeros(len(time))
    for frequency, amplitude, phase in WAVES:
        omega = 2 * np.pi * frequency
        total += amplitude * omega**derivative * np.sin(omega * time + phase + derivative * np.pi / 2)
    return total
