"""Tests whether a residual is stationary noise without spectral lines, of any size and colour.

Errors of a model depend on the motion: after impacts, at high speed, at one angle.  So the variance of the residual's
innovations varies more between blocks than that of noise; or their spectrum has a line.  Neither test needs the level
of the noise, which before a model fits is known to some 30 % at best.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lostmotion.lab import policy
from lostmotion.lab.data.noise import NoiseModel, innovation_noise
from lostmotion.model.motion import FloatArray

__all__ = ["is_structured", "spread"]

BLOCK = 40
"""Samples in a block: 50 ms at 800 Hz, a part of the ring after an impact."""


def is_structured(residuals: Sequence[FloatArray]) -> bool:
    """Whether these residuals (each (N,)) hold more than noise."""
    noise = innovation_noise(*residuals)
    return spread(noise, residuals) > policy.SPREAD or _has_line(noise, residuals)


def spread(noise: NoiseModel, residuals: Sequence[FloatArray]) -> float:
    """The variance of the blocks' log-variances, relative to that of stationary Gaussian noise: 1 for noise."""
    logs = []
    for r in residuals:
        white = noise.whiten(r)
        blocks = white[np.isfinite(white)]
        blocks = blocks[: blocks.size // BLOCK * BLOCK].reshape(-1, BLOCK)
        if len(blocks):
            logs.append(np.log(np.maximum(np.mean(blocks**2, axis=1), 1e-300)))
    every = np.concatenate(logs) if logs else np.zeros(1)
    return float(np.var(every) / (2 / BLOCK)) if every.size > 1 else 1.0


def _has_line(noise: NoiseModel, residuals: Sequence[FloatArray]) -> bool:
    """Whether there is a line in the innovations' spectrum, averaged over the segments of one length.

    The average of K periodograms of white noise is chi-squared with 2 K degrees over 2 K; of all its bins the largest
    exceeds LINE times in the chance p.
    """
    from scipy.stats import chi2  # imported late: only this test needs it

    length = int(np.median([r.size for r in residuals]))
    alike = [noise.whiten(r[:length]) for r in residuals if r.size >= length]
    power = np.array([np.abs(np.fft.rfft(np.nan_to_num(white))) ** 2 / np.nansum(white**2) for white in alike])
    mean = power.mean(axis=0)[2:-1]
    return bool(
        mean.size and mean.size * chi2.sf(2 * len(alike) * float(mean.max()), 2 * len(alike)) < policy.FALSE_LINE
    )
