"""What struck the joint, from what the accelerometer at the bar's tip tells: eq. 7 turned round.  No commands here."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from lostmotion.detector.ringdown import ring
from lostmotion.detector.window import DetectorSettings, FloatArray

__all__ = ["STEP", "Edges", "Inverse", "edges", "integrated", "inverse", "mistuned", "noise_of"]

STEP = 0.145
"""Grid of the impulses in periods of the bar."""
IMPULSE = 0.1
"""Usual change of the joint's speed in a step of the grid [rad/s]."""
PIECES = 8
"""The response to impulses is made in so many pieces, which saves a robot's small computer five megabytes at its
start."""
MOST_KEPT = 12
"""So many inverses are kept: of each sensor, and of each size of its noise in powers of two.  One takes 2.1 MB for 0.85
s at 1 kHz, its answer to a wrong resonance 1.2 MB."""
LEAST_WIDTH, SAMPLES_WIDE = 3, 3.0
"""As long as the inverse makes an impulse: steps of the grid at least, and samples."""


@dataclass(frozen=True, slots=True, eq=False)
class Inverse:
    """Impulses at times (K,) from accelerations (N,): gain (K, N), and deviation (K,) of the sum of three neighbours;
    doubt (K, K): covariance of the angles that they make; slow_deviation (K,): that of the acceleration [rad/s²]
    averaged over a period of the bar."""

    times: FloatArray
    gain: NDArray[np.float32]
    deviation: FloatArray
    doubt: FloatArray
    slow_deviation: FloatArray

    @property
    def step(self) -> float:
        """From one impulse to the next [s]."""
        return float(self.times[1] - self.times[0])

    def impulses(self, accel: FloatArray) -> FloatArray:
        """Changes of the joint's speed [rad/s] that accelerations [m/s²] tell, (K,)."""
        return np.asarray(self.gain @ accel.astype(np.float32), np.float64)


@dataclass(frozen=True, slots=True, eq=False)
class Edges:
    """What stands out of a smooth motion at times (K,): what ``width`` neighbouring impulses have more than the mean of
    as many before and after, in gain (K, N) from accelerations (N,), and its standard deviation (K,)."""

    times: FloatArray
    width: int
    gain: FloatArray
    deviation: FloatArray


def noise_of(accel: FloatArray, settings: DetectorSettings) -> float:
    """The sensor's noise [m/s²]: calibrated, or from fourth differences, in powers of two so that few are prepared."""
    if settings.noise_ms2 is not None:
        return settings.noise_ms2
    middle = (accel.size - 4) // 2
    rough = float(np.partition(np.abs(np.diff(accel, 4)), middle)[middle]) / (0.6745 * math.sqrt(70))
    return float(2.0 ** round(math.log2(max(rough, 0.02))))


@lru_cache(maxsize=MOST_KEPT)
def inverse(length: int, rate_hz: float, noise: float, settings: DetectorSettings) -> Inverse:
    """Bayes' linear inverse of eq. 7 for impulses of usual size IMPULSE, a ring from before, and white noise."""
    times, gain, own = _solved(length, rate_hz, noise, settings)
    step, index, period = float(times[1] - times[0]), np.arange(times.size), round(1 / STEP)
    slow = (np.abs(index[:, None] - index) <= period // 2) / (period * step)
    sums = (np.abs(index[:, None] - index) <= 1).astype(np.float64)
    doubt = np.ascontiguousarray(integrated(integrated(own, step).T, step).T)
    return Inverse(times, gain.astype(np.float32), _deviation(sums, own), doubt, _deviation(slow, own))


def integrated(impulses: FloatArray, step: float) -> FloatArray:
    """Angles [rad] that impulses [rad/s] on a grid of that step [s] have made by each of its points: along the first
    axis, the sum over all earlier ones of the time since, times the impulse."""
    sums = step * np.cumsum(np.cumsum(impulses, axis=0), axis=0)
    return np.concatenate([np.zeros_like(sums[:1]), sums[:-1]])


def _solved(
    length: int, rate_hz: float, noise: float, settings: DetectorSettings
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Times (K,), gain (K, N) and covariance (K, K) of the impulses; not kept, it takes some megabytes."""
    time = np.arange(length) / rate_hz
    step = STEP / settings.f_res_hz
    impulses = np.arange(0.0, time[-1] - step / 2, step) + step / 2
    pieces = [_response(time[:, None] - some, settings) for some in np.array_split(impulses, PIECES)]
    response: FloatArray = np.hstack([*pieces, ring(time, settings)])
    count = impulses.size
    trust = np.concatenate([np.full(count, IMPULSE**-2), [1e-4, 1e-4]])
    covariance = np.linalg.inv(response.T @ response / noise**2 + np.diag(trust))
    gain = covariance @ response.T / noise**2
    return impulses, gain[:count], np.asarray(covariance[:count, :count], dtype=np.float64)


@lru_cache(maxsize=MOST_KEPT)
def mistuned(
    length: int, rate_hz: float, noise: float, settings: DetectorSettings, share: float
) -> NDArray[np.float32]:
    """What a resonance set wrong by that share adds to the angles that accelerations (N,) give, shape (K, N)."""
    right, gain, _ = _solved(length, rate_hz, noise, settings)
    wrong, other, _ = _solved(length, rate_hz, noise, replace(settings, f_res_hz=settings.f_res_hz * (1 + share)))
    angles = integrated(other, float(wrong[1] - wrong[0]))
    place = np.minimum(np.searchsorted(wrong, right, side="right"), wrong.size - 1)
    after = ((right - wrong[place - 1]) / (wrong[1] - wrong[0]))[:, None]
    added = (1 - after) * angles[place - 1] + after * angles[place] - integrated(gain, float(right[1] - right[0]))
    return np.asarray(added, np.float32)


@lru_cache(maxsize=16)
def edges(length: int, rate_hz: float, noise: float, settings: DetectorSettings) -> Edges:
    """The same inverse for impulses beside smooth motions of any size."""
    times, gain, own = _solved(length, rate_hz, noise, settings)
    step = STEP / settings.f_res_hz
    width = 2 * math.ceil((max(SAMPLES_WIDE / rate_hz / step, LEAST_WIDTH) - 1) / 2) + 1
    index = np.arange(times.size)
    wide = (np.abs(index[:, None] - index) <= width // 2).astype(np.float64)
    sharp = wide - (np.roll(wide, width, axis=0) + np.roll(wide, -width, axis=0)) / 2
    return Edges(times, width, sharp @ gain, _deviation(sharp, own))


def _deviation(rows: FloatArray, covariance: FloatArray) -> FloatArray:
    """Standard deviation of each row's combination."""
    return np.asarray(np.sqrt(np.sum((rows @ covariance) * rows, axis=1)))


def _response(after: FloatArray, settings: DetectorSettings) -> FloatArray:
    """Tip acceleration -(b q' + k q)/m after an impulse of 1 rad/s, which leaves q = 0, q' = -l (eq. 7)."""
    omega, zeta = 2 * math.pi * settings.f_res_hz, settings.zeta
    damped = omega * math.sqrt(1 - zeta**2)
    since = np.maximum(after, 0.0)
    decay = np.exp(-zeta * omega * since)
    sine, cosine = np.sin(damped * since), np.cos(damped * since)
    bent, rate = sine / damped, cosine - zeta * omega / damped * sine
    return np.where(after >= 0, settings.length_m * decay * (2 * zeta * omega * rate + omega**2 * bent), 0.0)
