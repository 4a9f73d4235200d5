"""Autoregressive noise models x_t = a_1 x_(t-1) + … + a_p x_(t-p) + e_t: fitting, whitening, simulation.

The innovations e_t are independent, with one standard deviation; with p = 0 the noise is white.  Tests of a residual,
confidence intervals and the score test use these models.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from lostmotion.lab.data.series import rms, runs
from lostmotion.model.motion import FloatArray

__all__ = ["NoiseModel", "fit_autoregression"]

GRID = 1 << 14
"""Number of frequencies at which a spectrum is evaluated."""
LARGEST_ROOT = 0.998
"""Largest magnitude of a root of a model's polynomial, see ``_stable``."""
HUBER = 2.5
"""Bound of Huber's weights, in robust standard deviations."""
REWEIGHTINGS = 4
"""Number of fits, each with weights from the errors of the one before."""
EDGE = 4.0
"""Magnitude at which errors are clipped before their standard deviation is taken, in robust ones."""
OUTLIER, FEW = 8.0, 0.03
"""Samples beyond so many robust standard deviations are outliers; they are left out if their share is at most this."""
MAD = 1.4826
"""Standard deviation of normal values over the median of their magnitudes."""


@dataclass(frozen=True, eq=False)
class NoiseModel:
    """Stationary Gaussian noise of mean zero.  coefficients: a_1 … a_p (p,); innovation: standard deviation of e_t."""

    coefficients: FloatArray
    innovation: float

    @classmethod
    def white(cls, rms: float) -> NoiseModel:
        """White noise with this standard deviation."""
        return cls(np.zeros(0), float(rms))

    @property
    def order(self) -> int:
        """The order p."""
        return int(self.coefficients.size)

    @cached_property
    def rms(self) -> float:
        """The stationary standard deviation."""
        return float(np.sqrt(self.autocovariance(0)[0]))

    def autocovariance(self, most_lags: int) -> FloatArray:
        """The autocovariance at the lags 0 … most_lags (most_lags + 1,), from the spectrum."""
        return np.asarray(np.fft.irfft(self._power)[: most_lags + 1])

    def density(self, frequency_hz: FloatArray, rate_hz: float) -> FloatArray:
        """One-sided power spectral density at these frequencies (F,) [unit²/Hz]."""
        lags = np.arange(1, self.order + 1)
        response = 1 - np.exp(-2j * np.pi * np.outer(frequency_hz / rate_hz, lags)) @ self.coefficients
        return np.asarray(2 * self.innovation**2 / rate_hz / np.abs(response) ** 2)

    def whiten(self, x: FloatArray) -> FloatArray:
        """The standardised innovations (N,) of a series x (N,) of this noise, which are independent with variance 1;
        NaN where x is NaN.

        Each run without NaN is whitened separately.  Its first p samples are predicted by predictors of lower order, so
        that the sum of squares is that of the exact likelihood.
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

    def simulate(self, rng: np.random.Generator, *shape: int) -> FloatArray:
        """Random stationary series of a shape (..., N), independent of each other."""
        *many, samples = shape
        impulse = np.fft.irfft(1 / self._response)
        impulse = impulse[: int(np.flatnonzero(np.abs(impulse) > 1e-6)[-1]) + 1]
        noise = self.innovation * rng.standard_normal((*many, samples + impulse.size))
        length = 1 << (samples + 2 * impulse.size).bit_length()
        made = np.fft.irfft(np.fft.rfft(noise, length) * np.fft.rfft(impulse, length), length)
        return np.asarray(made[..., impulse.size : impulse.size + samples])

    @cached_property
    def _response(self) -> FloatArray:
        """1 - sum_k a_k exp(-2 pi i f k) on the grid of frequencies."""
        return np.asarray(np.fft.rfft(np.concatenate(([1.0], -self.coefficients)), GRID))

    @property
    def _power(self) -> FloatArray:
        return np.asarray(self.innovation**2 / np.abs(self._response) ** 2)

    @cached_property
    def _predictors(self) -> list[tuple[FloatArray, float]]:
        """For the orders 0 … p, the weights of the linear predictor, those of the newest samples first, and the
        standard deviation of its error (Levinson's recursion)."""
        gamma = self.autocovariance(self.order)
        weights, variance = np.zeros(0), float(gamma[0])
        found = [(weights, np.sqrt(variance))]
        for order in range(1, self.order + 1):
            partial = (gamma[order] - weights @ gamma[order - 1 : 0 : -1]) / variance
            weights = np.concatenate((weights - partial * weights[::-1], [partial]))
            variance *= 1 - partial**2
            found.append((weights, np.sqrt(variance)))
        return found


def fit_autoregression(series: Sequence[FloatArray], most: int = 8) -> NoiseModel:
    """Fits one autoregression to several series (N_i,), with NaN as gaps.

    The order, at most ``most``, has the least BIC.  The coefficients follow by least squares with Huber weights.
    Raises ValueError where no 4 samples follow each other.
    """
    segments = [x[run] for x in map(_without_outliers, series) for run in runs(x)]
    longest = max((x.size for x in segments), default=0)
    if longest < 4:
        raise ValueError("no four samples in a row: the noise cannot be estimated")
    most = min(most, longest // 4)
    windows = np.concatenate([sliding_window_view(x, most + 1)[:, ::-1] for x in segments if x.size > most])
    if not np.any(windows):
        return NoiseModel.white(0.0)
    gram, count = _weighted(windows)
    orders = [_solved(gram, order) for order in range(most + 1)]
    scores = [count * np.log(error) + order * np.log(count) for order, (_, error) in enumerate(orders)]
    coefficients, _ = orders[int(np.argmin(scores))]
    errors = windows[:, 0] - windows[:, 1 : 1 + coefficients.size] @ coefficients
    return NoiseModel(_stable(coefficients), _scale(errors))


def _without_outliers(x: FloatArray) -> FloatArray:
    """x with outliers, if they are few, replaced by NaN: each would spoil all windows that contain it."""
    far = np.abs(x) > OUTLIER * MAD * np.nanmedian(np.abs(x))
    return np.where(far, np.nan, x) if 0 < np.count_nonzero(far) < FEW * x.size else x


def _weighted(windows: FloatArray) -> tuple[FloatArray, float]:
    """Gram matrix (p + 1, p + 1) of the columns at lags 0 … p, with Huber's weights, and the sum of the weights."""
    weights = np.ones(len(windows))
    for _ in range(REWEIGHTINGS):
        gram = np.asarray((windows * weights[:, None]).T @ windows)
        coefficients, _ = _solved(gram, len(gram) - 1)
        errors = np.abs(windows[:, 0] - windows[:, 1:] @ coefficients)
        spread = max(MAD * float(np.median(errors)), 1e-12 * float(errors.max()))
        weights = np.minimum(1.0, HUBER * spread / np.maximum(errors, 1e-300))
    return gram, float(weights.sum())


def _solved(gram: FloatArray, order: int) -> tuple[FloatArray, float]:
    """The coefficients (order,) of the normal equations of this order, and the mean square error up to a factor."""
    across = gram[1 : order + 1, 0]
    coefficients = np.asarray(np.linalg.lstsq(gram[1 : order + 1, 1 : order + 1], across, rcond=None)[0])
    return coefficients, max(float(gram[0, 0] - across @ coefficients), 1e-300)


def _scale(errors: FloatArray) -> float:
    """The root mean square of errors (N,), those beyond ``EDGE`` robust standard deviations being clipped."""
    usual = MAD * float(np.median(np.abs(errors)))
    return rms(np.clip(errors, -EDGE * usual, EDGE * usual)) if usual else float(np.std(errors))


def _stable(coefficients: FloatArray) -> FloatArray:
    """The coefficients with the roots of their polynomial within ``LARGEST_ROOT`` of zero, so that simulations are
    stationary."""
    if not coefficients.size:
        return coefficients
    largest = float(np.max(np.abs(np.roots(np.concatenate(([1.0], -coefficients))))))
    if largest <= LARGEST_ROOT:
        return coefficients
    return np.asarray(coefficients * (LARGEST_ROOT / largest) ** np.arange(1, coefficients.size + 1))
