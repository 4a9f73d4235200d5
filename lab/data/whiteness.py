"""Tests of whether a residual is white, independent of the input, or stationary noise without lines, with bounds that
hold for coloured series.

The errors of a model depend on the motion: on impacts, on the speed, on the angle.  So the variance of the innovations
of a residual varies more between blocks than that of noise, or their spectrum has a line.  Neither test needs the level
of the noise, which before a model fits is known to some 30 % at best.  Comparisons and the search of gears use these
tests.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import chdtrc, erfcinv

from lostmotion.lab import policy
from lostmotion.lab.data.autoregression import NoiseModel, fit_autoregression
from lostmotion.model.motion import FloatArray

__all__ = ["Correlation", "autocorrelation", "cross_correlation", "fit_percent", "is_structured", "spread"]

LAGS = 25
"""Number of lags that are tested, at most a quarter of the samples."""
KEPT = 1e-3
"""Principal components of the lagged input with less of its power than this share are left out."""


@dataclass(frozen=True, eq=False)
class Correlation:
    """Correlations at several lags.

    lags (K,) [samples]; values: the correlation at each (K,); bound: of values of noise, at the level of
    ``policy.FALSE_NAME`` for all lags together; p_value: of the hypothesis that all of them are 0.
    """

    lags: FloatArray
    values: FloatArray
    bound: float
    p_value: float

    @property
    def significant(self) -> bool:
        """Whether the hypothesis that all are 0 is rejected."""
        return self.p_value < policy.FALSE_NAME


def fit_percent(measured: FloatArray, modelled: FloatArray) -> float:
    """The fit 100 (1 - |y - y'|/|y - mean y|) [%] of modelled y' to measured y (N,), with NaN left out; 100 is perfect,
    0 as good as the mean."""
    there = np.isfinite(measured) & np.isfinite(modelled)
    y = measured[there]
    error, spread = float(np.linalg.norm(y - modelled[there])), float(np.linalg.norm(y - y.mean()))
    return 100 * (1 - error / max(spread, 1e-300))


def autocorrelation(residual: FloatArray) -> Correlation:
    """The autocorrelation of a residual (N,), with NaN as gaps, at the lags 1 … LAGS.

    The p-value is that of Q = N (N + 2) sum_k r_k²/(N - k), which is chi-squared with one degree of freedom for each
    lag (Ljung and Box 1978).
    """
    there = np.isfinite(residual)
    count = int(there.sum())
    most_lags = min(LAGS, count // 4)
    x = np.where(there, residual - np.mean(residual[there]), 0.0)
    products = _correlate(x, x, most_lags)[1:]
    r = products / max(float(x @ x), 1e-300)
    pairs = np.maximum(_correlate(there.astype(float), there.astype(float), most_lags)[1:], 1.0)
    q = count * (count + 2) * float(np.sum(r**2 / pairs))
    lags = np.arange(1.0, most_lags + 1)
    return Correlation(lags, r, _bound(most_lags) / np.sqrt(count), float(chdtrc(max(most_lags, 1), q)))


def cross_correlation(residual: FloatArray, source: FloatArray) -> Correlation:
    """The correlation of a residual (N,) with an input (N,), with NaN as gaps, at the lags 0 … LAGS by which the
    residual follows the input.

    Both are whitened by the noise model of the residual.  For a white residual each correlation has the variance 1/N,
    whatever the spectrum of the input (Haugh 1976).  For raw series it is (1 + 2 sum rho_e rho_u)/N (Bartlett), often
    ten times as much.  The lagged values of a smooth input are nearly collinear; the p-value takes this into account (a
    score test of a finite impulse response from input to residual).
    """
    noise = fit_autoregression([residual])
    e = noise.whiten(residual - np.nanmean(residual))
    u = noise.whiten(np.where(np.isfinite(residual), source - np.nanmean(source), np.nan))
    there = np.isfinite(e) & np.isfinite(u)
    e, u = np.where(there, e, 0.0), np.where(there, u, 0.0)
    count = int(there.sum())
    most_lags = min(LAGS, count // 4)
    scale = np.sqrt(max(float((e @ e) * (u @ u)), 1e-300))
    r = _correlate(e, u, most_lags) / scale
    own = _correlate(u, u, most_lags) / max(float(u @ u), 1e-300)
    lags = np.arange(most_lags + 1)
    power, directions = np.linalg.eigh(own[np.abs(lags[:, None] - lags)])
    kept = power > KEPT * power[-1]
    statistic = count * float(np.sum((directions[:, kept].T @ r) ** 2 / power[kept]))
    return Correlation(
        lags.astype(float), r, _bound(int(kept.sum())) / np.sqrt(count), float(chdtrc(int(kept.sum()), statistic))
    )


def _correlate(x: FloatArray, y: FloatArray, most_lags: int) -> FloatArray:
    """sum_t x_(t+k) y_t for k = 0 … most_lags."""
    length = 1 << int(2 * x.size - 1).bit_length()
    product = np.fft.rfft(x, length) * np.conj(np.fft.rfft(y, length))
    return np.asarray(np.fft.irfft(product, length)[: most_lags + 1])


def _bound(tests: int) -> float:
    """The magnitude that none of so many independent normal deviates exceeds, at the level ``policy.FALSE_NAME``
    (Sidak)."""
    return float(np.sqrt(2) * erfcinv(1 - (1 - policy.FALSE_NAME) ** (1 / max(tests, 1))))


BLOCK = 40
"""Samples in a block: 50 ms at 800 Hz, a part of the ring after an impact."""


def is_structured(residuals: Sequence[FloatArray]) -> bool:
    """Whether these residuals, (N_i,) each, are more than stationary noise without lines."""
    noise = fit_autoregression(residuals)
    return spread(noise, residuals) > policy.SPREAD or _has_line(noise, residuals)


def spread(noise: NoiseModel, residuals: Sequence[FloatArray]) -> float:
    """The variance over blocks of the logarithm of the residuals' variance, relative to that of stationary Gaussian
    noise, for which it is 1; noise: the model that whitens them."""
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
    """Whether the spectrum of the innovations has a line, averaged over the segments of one length.

    The average of K periodograms of white noise is chi-squared with 2 K degrees of freedom over 2 K.  The largest of
    all bins is compared with this at the level ``policy.FALSE_LINE`` (Bonferroni).
    """
    from scipy.stats import chi2  # imported late: only this test needs it

    length = int(np.median([r.size for r in residuals]))
    alike = [noise.whiten(r[:length]) for r in residuals if r.size >= length]
    power = np.array([np.abs(np.fft.rfft(np.nan_to_num(white))) ** 2 / np.nansum(white**2) for white in alike])
    mean = power.mean(axis=0)[2:-1]
    return bool(
        mean.size and mean.size * chi2.sf(2 * len(alike) * float(mean.max()), 2 * len(alike)) < policy.FALSE_LINE
    )
