"""How much of an effect shows: what the best fit of the base leaves of it, over short segments.  No noise, no files.

The base is fitted to the clean signal, its parameters in common and the state at the start of each segment free, so
that what play, bar and start can imitate does not count.  A fixed-step integrator does: this only sets sizes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.optimize import least_squares

from bench.hidden_effects.physics import Command, Values, layout, motion

__all__ = ["Segment", "left_by_base"]

FloatArray = NDArray[np.float64]
STEPS = 8
"""Steps of the integrator from one sample to the next."""
FITTED = ("d", "alpha", "l", "b", "k")
STARTS = np.array([1e-4, 1e-2, 1e-5, 1e-3])
"""Sizes of a change in the state at a start: theta_2, omega_2, q, q'."""
DIFFERENCE = 1e-3
WORST = 1e3
"""Where a residual [m/s²] ends, as when the gears begin deep within each other."""
ROUNDS = 10


@njit(cache=True)
def _accel(v, where, state, start_time, samples, interval):  # type: ignore[no-untyped-def]
    """What the accelerometer feels at the samples (N,), without its offset; Runge and Kutta's fourth order."""
    felt, y, moved, total = np.empty(samples), state.copy(), np.empty(12), np.empty(12)
    k, h = np.empty(12), interval / STEPS
    for i in range(samples):
        for j in range(STEPS):
            t = start_time + i * interval + j * h
            now = motion(y, t, v, where[0], where[1], where[2], k)
            if j == 0:
                felt[i] = now
            total[:] = k
            for ahead, weight in ((0.5, 2.0), (0.5, 2.0), (1.0, 1.0)):
                for c in range(12):
                    moved[c] = y[c] + ahead * h * k[c]
                motion(moved, t + ahead * h, v, where[0], where[1], where[2], k)
                for c in range(12):
                    total[c] += weight * k[c]
            for c in range(12):
                y[c] += h / 6 * total[c]
    return felt


@dataclass(frozen=True)
class Segment:
    """A piece of a recording: its command, the time of its first sample [s], the clean signal (N,), a state (12,) to
    begin from."""

    command: Command
    time: float
    signal: FloatArray
    state: FloatArray


def left_by_base(base: Values, segments: list[Segment], interval: float) -> float:
    """Root mean square [m/s²] of what the best base leaves of the segments, samples an interval [s] apart."""
    fit = _Fit({name: value for name, value in base.items() if "." not in name}, segments, interval)
    start = np.zeros(fit.common + 4 * len(segments))
    found = least_squares(fit.residual, start, fit.jacobian, loss="soft_l1", f_scale=2.0, max_nfev=ROUNDS)
    return float(np.sqrt(np.mean(fit.residual(found.x) ** 2)))


@dataclass(frozen=True)
class _Fit:
    """Residual and Jacobian for the unknowns: FITTED in steps of 2 %, the offset, four steps of STARTS a segment."""

    base: Values
    segments: list[Segment]
    interval: float
    common: int = len(FITTED) + 1

    def residual(self, x: FloatArray) -> FloatArray:
        return np.concatenate([self._of(i, x) for i in range(len(self.segments))])

    def jacobian(self, x: FloatArray) -> FloatArray:
        rows = []
        for i in range(len(self.segments)):
            own = self.common + 4 * i
            here, block = self._of(i, x), np.zeros((len(self.segments[i].signal), x.size))
            for column in (*range(self.common), *range(own, own + 4)):
                step = np.zeros_like(x)
                step[column] = DIFFERENCE
                block[:, column] = (self._of(i, x + step) - here) / DIFFERENCE
            rows.append(block)
        return np.concatenate(rows)

    def _of(self, i: int, x: FloatArray) -> FloatArray:
        """Residual of one segment."""
        segment = self.segments[i]
        changed = {name: self.base[name] * np.exp(0.02 * step) for name, step in zip(FITTED, x, strict=False)}
        state = segment.state.copy()
        state[:4] += STARTS * x[self.common + 4 * i : self.common + 4 * i + 4]
        samples = len(segment.signal)
        felt = _accel(
            layout({**self.base, **changed}), segment.command.where, state, segment.time, samples, self.interval
        )
        left = segment.signal - felt - x[self.common - 1]
        return np.asarray(np.where(np.isfinite(left), np.clip(left, -WORST, WORST), WORST))
