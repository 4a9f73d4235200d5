"""Impulses on the joint from the acceleration of the bar's tip: the inverse of eq. 7.  No commands here."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from lostmotion.detector.ringdown import ring
from lostmotion.detector.window import DetectorSettings, FloatArray

__all__ = ["DIFFERENCES", "STEP", "Edges", "Inverse", "edges", "integrated", "inverse", "mistuned", "noise_of"]

STEP = 0.145
"""Grid of the impulses in periods of the bar."""
IMPULSE = 0.1
"""Usual change of the joint's speed in a step of the grid [rad/s]."""
AT_ONCE = 64
"""Samples for which a gain is formed at once: that of 850 with its intermediate results takes 15 MB for a moment."""
MOST_KEPT = 8
"""Inverses that are cached: of each sensor, and of each step of its noise.  One takes 2.1 MB for 0.85 s at 1 kHz, its
response to a wrong resonance 1.2 MB, its edges 1.2 MB."""
OCTAVE = 4
"""Steps of a calibrated or learnt noise within a factor of two: 9 % of its size, less than it differs between windows
(FREEDOM of ``background``).  Without steps, each noise that is learnt would need another inverse."""
DIFFERENCES = 0.6745 * math.sqrt(70)
"""Median size of white noise's fourth differences, in its standard deviations."""
LEAST_WIDTH, SAMPLES_WIDE = 3, 3.0
"""Width of an impulse in the inverse: least steps of the grid, and samples."""


@dataclass(frozen=True, slots=True, eq=False)
class Inverse:
    """Impulses at times (K,) from accelerations (N,): gain (K, N), and deviation (K,) of the sum of three neighbours;
    angle_covariance (K, K): of their second integral; slow_deviation (K,): that of the acceleration [rad/s²] averaged
    over a period of the bar."""

    times: FloatArray
    gain: NDArray[np.float32]
    deviation: FloatArray
    angle_covariance: FloatArray
    slow_deviation: FloatArray

    @property
    def step(self) -> float:
        """From one impulse to the next [s]."""
        return float(self.times[1] - self.times[0])

    def impulses(self, accel: FloatArray) -> FloatArray:
        """Changes of the joint's speed [rad/s] from accelerations [m/s²], (K,)."""
        return np.asarray(self.gain @ accel.astype(np.float32), np.float64)


@dataclass(frozen=True, slots=True, eq=False)
class Edges:
    """Deviations from a smooth motion at times (K,): the sum of ``width`` neighbouring impulses minus the mean of those
    of as many before and after, by gain (K, N) from accelerations (N,), and its standard deviation (K,)."""

    times: FloatArray
    width: int
    gain: NDArray[np.float32]
    deviation: FloatArray

    def impulses(self, accel: FloatArray) -> FloatArray:
        """The deviations (K,) [rad/s] from accelerations [m/s²]."""
        return np.asarray(self.gain @ accel.astype(np.float32), np.float64)


@dataclass(frozen=True, slots=True, eq=False)
class _Posterior:
    """Impulses at times (K,) given accelerations (N,) of white noise: covariance, (K + 2, K + 2), with both phases of
    the previous ring at the end.  The gain is formed for some samples at a time, as it takes megabytes."""

    times: FloatArray
    covariance: FloatArray
    at: FloatArray
    noise: float
    settings: DetectorSettings

    @classmethod
    def of(cls, length: int, rate_hz: float, noise: float, settings: DetectorSettings) -> _Posterior:
        """Bayes' linear inverse of eq. 7 for impulses of usual size IMPULSE."""
        at, step = np.arange(length) / rate_hz, STEP / settings.f_res_hz
        times = np.arange(0.0, at[-1] - step / 2, step) + step / 2
        precision = np.diag(np.concatenate([np.full(times.size, IMPULSE**-2), [1e-4, 1e-4]]))
        for i in range(0, length, AT_ONCE):
            response = _responses(at[i : i + AT_ONCE], times, settings)
            precision += response.T @ response / noise**2
        return cls(times, np.linalg.inv(precision), at, noise, settings)

    @property
    def step(self) -> float:
        """From one impulse to the next [s]."""
        return float(self.times[1] - self.times[0])

    @property
    def own(self) -> FloatArray:
        """Covariance of the impulses alone, (K, K)."""
        return self.covariance[: self.times.size, : self.times.size]

    def gain(self, samples: slice) -> FloatArray:
        """The impulses' gain from accelerations at these samples, (K, n)."""
        response = _responses(self.at[samples], self.times, self.settings)
        return np.asarray(self.covariance[: self.times.size] @ response.T / self.noise**2)

    def mapped(self, change: Callable[[slice], FloatArray]) -> NDArray[np.float32]:
        """``change`` of each part of the samples, joined, (K, N)."""
        out = np.empty((self.times.size, self.at.size), np.float32)
        for i in range(0, self.at.size, AT_ONCE):
            out[:, i : i + AT_ONCE] = change(slice(i, i + AT_ONCE))
        return out


def noise_of(accel: FloatArray, settings: DetectorSettings) -> float:
    """The sensor's noise [m/s²]: calibrated or learnt, or from fourth differences; rounded, to need few inverses."""
    if settings.noise_ms2 is not None:
        return float(2.0 ** (round(OCTAVE * math.log2(settings.noise_ms2)) / OCTAVE))
    middle = (accel.size - 4) // 2
    rough = float(np.partition(np.abs(np.diff(accel, 4)), middle)[middle]) / DIFFERENCES
    return float(2.0 ** round(math.log2(max(rough, 0.02))))


def _bar(settings: DetectorSettings) -> DetectorSettings:
    """Only the settings that the inverses depend on."""
    return DetectorSettings(settings.f_res_hz, settings.zeta, length_m=settings.length_m)


def inverse(length: int, rate_hz: float, noise: float, settings: DetectorSettings) -> Inverse:
    """Bayes' linear inverse of eq. 7 for impulses of usual size IMPULSE, a previous ring, and white noise."""
    return _inverse(length, rate_hz, noise, _bar(settings))


@lru_cache(maxsize=MOST_KEPT)
def _inverse(length: int, rate_hz: float, noise: float, settings: DetectorSettings) -> Inverse:
    posterior = _Posterior.of(length, rate_hz, noise, settings)
    index, period = np.arange(posterior.times.size), round(1 / STEP)
    slow = (np.abs(index[:, None] - index) <= period // 2) / (period * posterior.step)
    sums = (np.abs(index[:, None] - index) <= 1).astype(np.float64)
    angle_covariance = np.ascontiguousarray(integrated(integrated(posterior.own, posterior.step).T, posterior.step).T)
    return Inverse(
        posterior.times,
        posterior.mapped(posterior.gain),
        _deviation(sums, posterior.own),
        angle_covariance,
        _deviation(slow, posterior.own),
    )


def integrated(impulses: FloatArray, step: float) -> FloatArray:
    """Angles [rad] at each point of a grid of that step [s] from impulses [rad/s] on it: along the first axis, the sum
    over all earlier impulses of impulse times the time since."""
    sums = step * np.cumsum(np.cumsum(impulses, axis=0), axis=0)
    return np.concatenate([np.zeros_like(sums[:1]), sums[:-1]])


def mistuned(
    length: int, rate_hz: float, noise: float, settings: DetectorSettings, share: float
) -> NDArray[np.float32]:
    """Gain from accelerations (N,) to the error of the angles by a resonance wrong by that share, shape (K, N)."""
    return _mistuned(length, rate_hz, noise, _bar(settings), share)


@lru_cache(maxsize=MOST_KEPT)
def _mistuned(
    length: int, rate_hz: float, noise: float, settings: DetectorSettings, share: float
) -> NDArray[np.float32]:
    right = _Posterior.of(length, rate_hz, noise, settings)
    wrong = _Posterior.of(length, rate_hz, noise, replace(settings, f_res_hz=settings.f_res_hz * (1 + share)))
    place = np.minimum(np.searchsorted(wrong.times, right.times, side="right"), wrong.times.size - 1)
    after = ((right.times - wrong.times[place - 1]) / wrong.step)[:, None]

    def added(samples: slice) -> FloatArray:
        angles = integrated(wrong.gain(samples), wrong.step)
        there = (1 - after) * angles[place - 1] + after * angles[place]
        return np.asarray(there - integrated(right.gain(samples), right.step))

    return right.mapped(added)


def edges(length: int, rate_hz: float, noise: float, settings: DetectorSettings) -> Edges:
    """The same inverse for impulses in addition to smooth motions of any size."""
    return _edges(length, rate_hz, noise, _bar(settings))


@lru_cache(maxsize=MOST_KEPT)
def _edges(length: int, rate_hz: float, noise: float, settings: DetectorSettings) -> Edges:
    posterior = _Posterior.of(length, rate_hz, noise, settings)
    width = 2 * math.ceil((max(SAMPLES_WIDE / rate_hz / posterior.step, LEAST_WIDTH) - 1) / 2) + 1
    index = np.arange(posterior.times.size)
    wide = (np.abs(index[:, None] - index) <= width // 2).astype(np.float64)
    sharp = wide - (np.roll(wide, width, axis=0) + np.roll(wide, -width, axis=0)) / 2
    gain = posterior.mapped(lambda samples: sharp @ posterior.gain(samples))
    return Edges(posterior.times, width, gain, _deviation(sharp, posterior.own))


def _deviation(rows: FloatArray, covariance: FloatArray) -> FloatArray:
    """Standard deviation of each row's combination."""
    return np.asarray(np.sqrt(np.sum((rows @ covariance) * rows, axis=1)))


def _responses(at: FloatArray, times: FloatArray, settings: DetectorSettings) -> FloatArray:
    """Accelerations at ``at`` (n,) after an impulse at each of the times (K,) and of both phases of a previous ring,
    shape (n, K + 2)."""
    return np.hstack([_response(at[:, None] - times, settings), ring(at, settings)])


def _response(after: FloatArray, settings: DetectorSettings) -> FloatArray:
    """Tip acceleration -(b q' + k q)/m after an impulse of 1 rad/s, which leaves q = 0, q' = -l (eq. 7)."""
    omega, zeta = 2 * math.pi * settings.f_res_hz, settings.zeta
    damped = omega * math.sqrt(1 - zeta**2)
    since = np.maximum(after, 0.0)
    decay = np.exp(-zeta * omega * since)
    sine, cosine = np.sin(damped * since), np.cos(damped * since)
    bent, rate = sine / damped, cosine - zeta * omega / damped * sine
    return np.where(after >= 0, settings.length_m * decay * (2 * zeta * omega * rate + omega**2 * bent), 0.0)
