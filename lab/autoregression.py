"""Autoregressive noise: fitted, whitened, simulated.  Nothing is known here of models or of what is noise.

x_t = a_1 x_(t-1) + … + a_p x_(t-p) + e_t with independent e_t of one standard deviation; p = 0 is white noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from lostmotion.model.motion import FloatArray

__all__ = ["NoiseModel", "fit_autoregression", "runs"]

GRID = 1 << 14
"""Frequencies at which a spectrum is taken to be known everywhere."""
LARGEST_ROOT = 0.998
HUBER = 2.5
REWEIGHTINGS = 4
MAD = 1.4826


@dataclass(frozen=True, eq=False)
class NoiseModel:
    """Stationary Gaussian noise of mean zero: coefficients a (p,), and the standard deviation of e_t."""

    coefficients: FloatArray
    innovation: float

    @classmethod
    def white(cls, rms: float) -> NoiseModel:
        """Independent samples."""
        return cls(np.zeros(0), float(rms))

    @property
    def order(self) -> int:
        """p."""
        return int(self.coefficients.size)

    @cached_property
    def rms(self) -> float:
        """The stationary standard deviation."""
        return float(np.sqrt(self.autocovariance(0)[0]))

    def autocovariance(self, most_lags: int) -> FloatArray:
        """gamma(0 … most_lags), from the spectrum."""
        return np.asarray(np.fft.irfft(self._power)[: most_lags + 1])

    def density(self, frequency_hz: FloatArray, rate_hz: float) -> FloatArray:
        """One-sided power spectral density, unit² per Hz."""
        lags = np.arange(1, self.order + 1)
        response = 1 - np.exp(-2j * np.pi * np.outer(frequency_hz / rate_hz, lags)) @ self.coefficients
        return np.asarray(2 * self.innovation**2 / rate_hz / np.abs(response) ** 2)

    def whiten(self, x: FloatArray) -> FloatArray:
        """Independent samples of variance 1 where x (N,) is this noise; NaN where x is, each run beginning afresh.

        The first p samples of a run are predicted by the predictors of lower order, so that the sum of squares is
        that of the exact likelihood.
        """
        white = np.full(x.shape, np.nan)
        predictors = self._predictors
        for run in runs(x):
            values = x[run]
            for order, (weights, deviation) in enumerate(predictors):
                if order < self.order and order < values.size:
                    white[run.start + order] = (values[order] - weights @ values[:order][::-1]) / deviation
            if values.size > self.order:
                weights, deviation = predictors[-1]
                filtered = np.convolve(values, np.concatenate(([1.0], -weights)), "valid")
                white[run.start + self.order : run.stop] = filtered / deviation
        return white

    def simulate(self, rng: np.random.Generator, samples: int) -> FloatArray:
        """A stationary stretch (samples,)."""
        impulse = np.fft.irfft(1 / self._response)
        last = int(np.flatnonzero(np.abs(impulse) > 1e-6)[-1]) + 1
        noise = self.innovation * rng.standard_normal(samples + last)
        length = 1 << (noise.size + last).bit_length()
        made = np.fft.irfft(np.fft.rfft(noise, length) * np.fft.rfft(impulse[:last], length), length)
        return np.asarray(made[last : last + samples])

    @cached_property
    def _response(self) -> FloatArray:
        """A(f) = 1 - sum a_k exp(-2 pi i f k) on the grid."""
        return np.asarray(np.fft.rfft(np.concatenate(([1.0], -self.coefficients)), GRID))

    @property
    def _power(self) -> FloatArray:
        return np.asarray(self.innovation**2 / np.abs(self._response) ** 2)

    @cached_property
    def _predictors(self) -> list[tuple[FloatArray, float]]:
        """Weights on the samples before, newest first, and the error's deviation, for 0 … p of them (Levinson)."""
        gamma = self.autocovariance(self.order)
        weights, variance = np.zeros(0), float(gamma[0])
        found = [(weights, np.sqrt(variance))]
        for order in range(1, self.order + 1):
            partial = (gamma[order] - weights @ gamma[order - 1 : 0 : -1]) / variance
            weights = np.concatenate((weights - partial * weights[::-1], [partial]))
            variance *= 1 - partial**2
            found.append((weights, np.sqrt(variance)))
        return found


def runs(x: FloatArray) -> list[slice]:
    """The stretches of x (N,) without NaN."""
    finite = np.concatenate(([False], np.isfinite(x), [False]))
    edges = np.flatnonzero(finite[1:] != finite[:-1])
    return [slice(int(first), int(last)) for first, last in zip(edges[::2], edges[1::2], strict=True)]


def fit_autoregression(series: Sequence[FloatArray], most: int = 8) -> NoiseModel:
    """The order up to ``most`` by BIC, coefficients by least squares with Huber weights; NaN are gaps.

    Raises ValueError where less than 4 samples follow each other.
    """
    stretches = [x[run] for x in series for run in runs(x)]
    longest = max((x.size for x in stretches), default=0)
    if longest < 4:
        raise ValueError("no four samples in a row: nothing can be told of the noise")
    most = min(most, longest // 4)
    windows = np.concatenate([sliding_window_view(x, most + 1) for x in stretches if x.size > most])
    now, before = windows[:, -1], windows[:, -2::-1] if most else windows[:, :0]
    if not np.any(now):
        return NoiseModel.white(0.0)
    fits = [_robust(before[:, :order], now) for order in range(most + 1)]
    rows = now.size
    scores = [2 * rows * np.log(max(scale, 1e-300)) + order * np.log(rows) for order, (_, scale) in enumerate(fits)]
    coefficients, scale = fits[int(np.argmin(scores))]
    return NoiseModel(_stable(coefficients), scale)


def _robust(before: FloatArray, now: FloatArray) -> tuple[FloatArray, float]:
    """Huber regression: coefficients, and the root mean square of the errors with far ones cut down."""
    weights = np.ones(now.size)
    coefficients = np.zeros(before.shape[1])
    for _ in range(REWEIGHTINGS):
        weighted = before * weights[:, None]
        if before.shape[1]:
            coefficients = np.asarray(np.linalg.lstsq(weighted.T @ before, weighted.T @ now, rcond=None)[0])
        errors = np.abs(now - before @ coefficients)
        spread = max(MAD * float(np.median(errors)), 1e-12 * float(errors.max()), 1e-300)
        weights = np.minimum(1.0, HUBER * spread / np.maximum(errors, 1e-300))
    clipped = np.minimum(errors, 2 * HUBER * spread)
    return coefficients, float(np.sqrt(np.mean(clipped**2)))


def _stable(coefficients: FloatArray) -> FloatArray:
    """The same with roots no nearer to the unit circle than noise that can be simulated allows."""
    if not coefficients.size:
        return coefficients
    largest = float(np.max(np.abs(np.roots(np.concatenate(([1.0], -coefficients))))))
    if largest <= LARGEST_ROOT:
        return coefficients
    return np.asarray(coefficients * (LARGEST_ROOT / largest) ** np.arange(1, coefficients.size + 1))
