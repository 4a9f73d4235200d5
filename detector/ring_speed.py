"""The change of a joint's speed from the clearest new ring of the bar in one segment.  No commands, no play here."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from lostmotion.detector import legendre
from lostmotion.detector.deconvolution import DIFFERENCES
from lostmotion.detector.median import median
from lostmotion.detector.ringdown import SLOW_HZ, SLOW_SHARE, ring
from lostmotion.detector.window import DetectorSettings, FloatArray

__all__ = ["speed_of_impact"]

NOISE_RINGS = 2.2
"""The largest ring in noise alone, in standard deviations of its amplitude."""
STARTS, FIRST_START, LAST_START = 40, 1.5, 1.0
"""Number of start times at which a ring is searched for; the first and last, in periods after the segment's begin and
before its end."""
PIECE_S, LEAST_PIECE, LEAST_NOISE = 0.03, 15, 1e-3
"""Pieces of the segment, from the quietest of which the noise is estimated [s, samples, m/s²]."""


@dataclass(frozen=True, slots=True, eq=False)
class _Rings:
    """Ring-downs from each of K start times on, without slow motion and previous rings: orthonormal pairs (2 K, N), and
    matrices (K, 2, 2) from a pair's coordinates to amplitudes [m/s²]."""

    pairs: FloatArray
    amplitudes: FloatArray


def speed_of_impact(accel: FloatArray, rate_hz: float, settings: DetectorSettings) -> tuple[float, float, float]:
    """Change of the joint's speed [rad/s] from the clearest new ring; the noise [m/s²]; the speed from noise alone."""
    known = _rings(accel.size, rate_hz, settings)
    found = (known.pairs @ accel).reshape(-1, 2)
    best = int(np.argmax(np.sum(found**2, axis=1)))
    noise = settings.noise_ms2 or _noise(accel, rate_hz, settings)
    lever = abs(settings.length_m) * 2 * math.pi * settings.f_res_hz
    amplitude = float(np.linalg.norm(known.amplitudes[best] @ found[best]))
    deviation = noise * float(np.linalg.norm(known.amplitudes[best])) / math.sqrt(2)
    return amplitude / lever, noise, NOISE_RINGS * deviation / lever


def _noise(accel: FloatArray, rate_hz: float, settings: DetectorSettings) -> float:
    """The sensor's noise [m/s²]: from fourth differences, or, where these contain the ring because it has few samples a
    period, the second quietest of some pieces, without slow motion and ring, and most likely without an impact."""
    length = max(round(PIECE_S * rate_hz), LEAST_PIECE)
    count = accel.size // length
    pieces = accel[: count * length].reshape(count, length)
    held = _held(length, rate_hz, settings)
    left = pieces - (pieces @ held) @ held.T
    power = np.sort(np.sum(left**2, axis=1))[min(1, count - 1)]
    found = math.sqrt(float(power) / (length - held.shape[1]))
    rough = median(np.abs(np.diff(accel, 4))) / DIFFERENCES
    return max(min(found, rough), LEAST_NOISE)


@lru_cache(maxsize=16)
def _held(length: int, rate_hz: float, settings: DetectorSettings) -> FloatArray:
    """A cubic and a ring, orthonormal columns."""
    columns = np.hstack(
        [legendre.scaled_values(np.linspace(-1, 1, length), 3), ring(np.arange(length) / rate_hz, settings)]
    )
    return np.asarray(np.linalg.qr(columns)[0])


@lru_cache(maxsize=16)
def _rings(length: int, rate_hz: float, settings: DetectorSettings) -> _Rings:
    """The rings of segments of ``length`` samples."""
    time = np.arange(length) / rate_hz
    degree = max(int(2 * min(SLOW_HZ, SLOW_SHARE * settings.f_res_hz) * time[-1]), 3)
    before = np.linalg.qr(
        np.hstack([legendre.scaled_values(np.linspace(-1, 1, length), degree), ring(time, settings)])
    )[0]
    pairs, amplitudes = [], []
    for start in np.linspace(FIRST_START / settings.f_res_hz, time[-1] - LAST_START / settings.f_res_hz, STARTS):
        pair = ring(time - start, settings)
        direction, size = np.linalg.qr(pair - before @ (before.T @ pair))
        pairs.append(direction.T)
        amplitudes.append(np.linalg.inv(size))
    return _Rings(np.vstack(pairs), np.array(amplitudes))
