"""Tests whether a residual is white, and independent of the input, with bounds that hold for coloured series.  No
plots."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import chdtrc, erfcinv

from lostmotion.lab import policy
from lostmotion.lab.data.autoregression import NoiseModel, fit_autoregression
from lostmotion.model.motion import FloatArray

__all__ = ["Correlation", "autocorrelation", "cross_correlation", "fit_percent"]

LAGS = 25
"""Number of lags that are tested, at most a quarter of the samples."""
KEPT = 1e-3
"""Principal components of the lagged input with less of its power than this share are left out."""


@dataclass(frozen=True, eq=False)
class Correlation:
    """lags [samples]; values: the correlation at each; bound: beyond it a value differs from 0, at 5 % for all lags
    together; p_value: of all of them being 0."""

    lags: FloatArray
    values: FloatArray
    bound: float
    p_value: float

    @property
    def significant(self) -> bool:
        """Whether they are not all 0, at 5 %."""
        return self.p_value < policy.SIGNIFICANT


def fit_percent(measured: FloatArray, modelled: FloatArray) -> float:
    """100 (1 - |y - y'|/|y - mean y|), the NRMSE fit [%]: 100 is perfect, 0 as good as the mean; NaN are left out."""
    there = np.isfinite(measured) & np.isfinite(modelled)
    y = measured[there]
    error, spread = float(np.linalg.norm(y - modelled[there])), float(np.linalg.norm(y - y.mean()))
    return 100 * (1 - error / max(spread, 1e-300))


def autocorrelation(residual: FloatArray) -> Correlation:
    """Autocorrelation of a residual (N,), NaN being gaps, at lags 1 … LAGS.

    p_value: Ljung and Box's Q = N (N + 2) sum r_k²/(N - k), chi-squared with one degree of freedom for each lag.
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


def cross_correlation(residual: FloatArray, source: FloatArray, noise: NoiseModel | None = None) -> Correlation:
    """Correlation of a residual (N,) with an input, both whitened by the residual's noise model, at lags 0 … LAGS.

    Positive lags: the residual follows the input.  After Haugh, with a white residual each correlation has the variance
    1/N whatever the input's spectrum, while of raw series it is (1 + 2 sum rho_e rho_u)/N (Bartlett), often ten times
    as much.  The lags of a smooth input are nearly collinear; p_value takes that into account (a score test of a finite
    impulse response from input to residual).  NaN are gaps.
    """
    noise = noise or fit_autoregression([residual])
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
    """The normal deviate that none of so many exceeds in 95 % of cases (Sidak)."""
    return float(np.sqrt(2) * erfcinv(1 - (1 - policy.SIGNIFICANT) ** (1 / max(tests, 1))))
