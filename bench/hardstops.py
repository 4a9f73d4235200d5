"""A third simulator of a joint with play, independent of eqs. 1-5 and of MuJoCo, and motions to move it with.

The driven gear strikes rigid teeth with a coefficient of restitution, comes to rest on a flank and leaves it when the
commanded acceleration pulls the teeth apart; friction and the bar's reaction on the joint are in it.  No detector here.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numba import njit  # type: ignore[import-untyped, unused-ignore]
from numpy.typing import NDArray

from bench.roc.waveforms import LENGTH_M, Bar
from lostmotion.model import HandWaved, Motion

__all__ = ["INERTIA", "MOTIONS", "Sines", "Trapezoids", "hard_stops"]

FloatArray = NDArray[np.float64]
INERTIA = 2e-4
"""Of the joint [kg m²]."""
STEP_S = 4e-5
REST = 0.004
"""Relative speed [rad/s] below which teeth that meet stay together."""


@dataclass(frozen=True)
class Sines:
    """A sum of eight sines of equal acceleration from 0.4 Hz to top_hz, ``peak`` [rad/s²] its root mean square."""

    seed: int
    top_hz: float
    peak: float = 25.0

    def _sum(self, t: FloatArray, order: int) -> FloatArray:
        rng = np.random.default_rng(self.seed)
        omega = 2 * math.pi * rng.uniform(0.4, self.top_hz, 8)
        phase = rng.uniform(0, 2 * math.pi, 8)
        size = self.peak * math.sqrt(2 / 8) / omega**2
        parts = (a * w**order * np.sin(w * t + p + order * math.pi / 2)
                 for a, w, p in zip(size, omega, phase, strict=True))  # fmt: skip
        return np.asarray(sum(parts))

    def position(self, t: FloatArray) -> FloatArray:
        """Angle [rad]."""
        return self._sum(t, 0)

    def velocity(self, t: FloatArray) -> FloatArray:
        """Angular speed [rad/s]."""
        return self._sum(t, 1)

    def acceleration(self, t: FloatArray) -> FloatArray:
        """Angular acceleration [rad/s²]."""
        return self._sum(t, 2)


class Trapezoids:
    """Moves to random angles by a trapezoid of speed, of 15 to 40 rad/s² and at most 2 rad/s, with pauses between."""

    def __init__(self, seed: int, duration_s: float = 15.0) -> None:
        rng = np.random.default_rng(seed)
        self._fine = np.arange(0.0, duration_s, 2e-4)
        accel = np.zeros(self._fine.size)
        at, angle = 0.1, 0.0
        while at < duration_s - 1.5:
            goal = rng.uniform(-0.6, 0.6)
            way, pull = goal - angle, rng.uniform(15.0, 40.0)
            ramp = min(math.sqrt(abs(way) / pull), 2.0 / pull)
            cruise = abs(way) / (pull * ramp) - ramp
            for begin, sign in ((at, 1.0), (at + ramp + cruise, -1.0)):
                accel[(self._fine >= begin) & (self._fine < begin + ramp)] = sign * math.copysign(pull, way)
            at += 2 * ramp + cruise + rng.uniform(0.0, 0.3)
            angle = goal
        # A drive's own controller and shaft round the corners over some milliseconds.
        width = np.hanning(41)
        self._accel = np.convolve(accel, width / width.sum(), "same")
        self._speed = np.cumsum(self._accel) * 2e-4
        self._angle = np.cumsum(self._speed) * 2e-4

    def position(self, t: FloatArray) -> FloatArray:
        """Angle [rad]."""
        return np.interp(t, self._fine, self._angle)

    def velocity(self, t: FloatArray) -> FloatArray:
        """Angular speed [rad/s]."""
        return np.interp(t, self._fine, self._speed)

    def acceleration(self, t: FloatArray) -> FloatArray:
        """Angular acceleration [rad/s²]."""
        return np.interp(t, self._fine, self._accel)


MOTIONS: dict[str, Callable[[int], Motion]] = {
    "hand-waved": HandWaved,
    "sines to 2.4 Hz": lambda seed: Sines(seed, 2.4),
    "sines to 6 Hz": lambda seed: Sines(seed, 6.0),
    "trapezoids": Trapezoids,
}


def hard_stops(
    motion: Motion, times: FloatArray, play_rad: float, bar: Bar, restitution: float = 0.3, mass_kg: float = 5e-3,
    friction: float = 0.5,
) -> FloatArray:  # fmt: skip
    """Tip acceleration [m/s²] at times [s], evenly spaced from 0, without noise.

    play_rad: the whole play [rad]; mass_kg: that swings at the bar's end and pushes the joint back; friction: Coulomb's
    against the world, as an angular acceleration of the joint [rad/s²].
    """
    many = max(round((times[1] - times[0]) / STEP_S), 1)
    step = (times[1] - times[0]) / many
    fine = np.arange(times.size * many) * step
    return np.asarray(
        _run(motion.position(fine), motion.velocity(fine), motion.acceleration(fine), step, many, play_rad / 2,
             restitution, mass_kg * LENGTH_M / INERTIA, friction, 2 * math.pi * bar.f_res_hz, bar.zeta)
    )  # fmt: skip


@njit(cache=True)
def _run(
    angle: FloatArray, speed: FloatArray, accel: FloatArray, step: float, many: int, half: float, restitution: float,
    reaction: float, friction: float, omega: float, zeta: float,
) -> FloatArray:  # fmt: skip
    """Semi-implicit Euler; reaction: m l / J of the bar."""
    out = np.empty(angle.size // many)
    place, rate = angle[0], speed[0]
    bent, bent_rate = 0.0, 0.0
    resting = 0
    for i in range(angle.size):
        pull = 2 * zeta * omega * bent_rate + omega**2 * bent
        free = reaction * pull - (friction if rate > 0 else -friction if rate < 0 else 0.0)
        alpha = free
        if resting:
            if (accel[i] - free) * resting <= 0:
                resting = 0
            else:
                alpha = accel[i]
        before = rate
        rate += alpha * step
        if resting:
            rate = speed[i]
            place = angle[i] - resting * half
        else:
            place += rate * step
            gap = place - angle[i]
            side = 1 if gap <= -half else -1 if gap >= half else 0
            closing = rate - speed[i]
            if side and closing * side <= 0:
                place = angle[i] - side * half
                if abs(closing) < REST:
                    rate = speed[i]
                    resting = side
                else:
                    rate = speed[i] - restitution * closing
        # The bar feels every change of the joint's speed, smooth or sudden (eq. 7).
        bent_rate += -pull * step - 0.1 * (rate - before)
        bent += bent_rate * step
        if i % many == many - 1:
            out[i // many] = -(2 * zeta * omega * bent_rate + omega**2 * bent)
    return out
