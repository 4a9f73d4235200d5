"""Estimates the noise of a signal before any model is fitted.

Windows of a few dozen samples are projected off smooth motion and a ringing bar.  What is left in windows without an
impact or another disturbance is noise.  Searches and comparisons compare their errors with it.  The innovations of the
residual of a good fit (autoregression.py) are a better estimate.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from lostmotion.lab.data.autoregression import NoiseModel, fit_autoregression
from lostmotion.lab.data.experiment import Experiment, own_rows
from lostmotion.lab.data.series import resolution, runs
from lostmotion.model.motion import FloatArray

__all__ = ["noise_models", "noise_of", "quiet_noise"]

WINDOWS = (48, 24, 12)
"""Lengths of windows [samples]; the longest with enough windows in the signal is used."""
LEAST_WINDOWS = 8
"""Least number of windows, if they did not overlap by half."""
TREND_ORDER = 7
"""Degree of the polynomial that is projected out of a window."""
QUIETEST = 0.25
"""Share of the windows that are assumed to contain only noise."""
SURE = 1.0
"""Standard deviations of a window's variance above which it is not noise alone."""
CORRELATIONS = np.arange(-4, 10) / 10
"""Correlations of neighbouring samples that are compared."""
LINES = {48: 4, 24: 1, 12: 0}
"""Lines that are projected out of windows of each length: of the bar and of a fan, beside those of the motion.
A line takes four dimensions, the polynomial eight: in windows of 12 a line would leave none for the noise.
Of white noise of 0.2 m/s² beside a hum of 0.3 to 1.5 m/s² at 30 to 200 Hz (twelve simulated gears), two leave 0.96 to 8
times its size, three 0.92 to 8, four 0.90 to 1.01."""
PREDICTED_FROM, POOR = 20, 0.7
"""Largest order of the autoregression whose error of prediction is an upper bound of the noise; and the ratio of that
error to the innovation from windows, below which it is taken instead."""
PREFERS_WHITE = 10.0
"""Least gain of the log-likelihood for noise to count as coloured."""


SMALLEST = 1e-12
"""Least noise of a column, in its unit: that of readings without any is the rounding of numbers."""


def noise_models(experiments: Sequence[Experiment]) -> dict[str, NoiseModel]:
    """The noise model of each measured column: of those of all experiments the one with the median size, of two the
    smaller."""
    found: dict[str, list[NoiseModel]] = {}
    for one in experiments:
        for name, values in one.measured.items():
            found.setdefault(name, []).append(quiet_noise(values))
    return {name: sorted(every, key=lambda one: one.rms)[(len(every) - 1) // 2] for name, every in found.items()}


def noise_of(experiments: Sequence[Experiment]) -> dict[str, float]:
    """Root mean square of the noise of each measured column, in its unit."""
    return {name: max(one.rms, SMALLEST) for name, one in noise_models(experiments).items()}


def quiet_noise(values: FloatArray) -> NoiseModel:
    """The noise of a signal (N,), NaN where not sampled, as a first-order autoregression x_t = a x_(t-1) + e_t; it is
    at least the rounding of the signal.

    Its size over the true one, of simulated accelerations of the base play (hand-waved, f_res 45-75 Hz, 800 Hz, 4 s)
    with noise of 1-20 % of the signal, was 0.95-1.05 for white noise, 0.85-1.4 for AR(1) noise of 0.5 (up to 2.5 at
    1 %), 0.35-1.1 for 0.9, and 0.55-1.5 for pink noise: noise slower than a window cannot be separated from motion,
    and is extrapolated.  The innovations of a good fit's residual are within 2 % for all of these.

    Windows are projected off polynomials and slowly changing lines at the strongest frequencies; the quietest quarter,
    and all that are as quiet, give variance and correlation by restricted maximum likelihood.  For a signal that is
    driven at many frequencies the error of prediction from the last 20 samples is the better bound.  A column that was
    sampled in few of the rows is one signal at its own rate.
    """
    if (rows := own_rows(values)) is not None:
        values = values[rows]
    least = NoiseModel.white(resolution(values) / np.sqrt(12))
    windows = _windows(values)
    if windows is None:
        steps = np.diff(values[np.isfinite(values)])
        return NoiseModel.white(max(least.rms, 1.4826 * float(np.median(np.abs(steps))) / np.sqrt(2)))
    free = _complement(windows.shape[1], _lines(values, windows.shape[1]))
    rest = windows @ free
    if not np.any(rest):
        return least
    correlation, deviation = 0.0, 0.0
    for _ in range(3):
        quiet = rest[_is_quiet(rest, free, correlation)]
        correlation, deviation = _restricted(quiet, free)
    found = NoiseModel(np.array([correlation]) if correlation else np.zeros(0),
                       deviation * np.sqrt(1 - correlation**2))  # fmt: skip
    predicted = fit_autoregression([values], PREDICTED_FROM).innovation
    if predicted < POOR * found.innovation:
        found = NoiseModel.white(predicted)
    return found if found.rms > least.rms else least


def _windows(values: FloatArray) -> FloatArray | None:
    """Half overlapping windows (W, L) of a signal; None where there are not enough."""
    segments = [values[run] for run in runs(values)]
    for length in WINDOWS:
        found = [sliding_window_view(x, length)[:: length // 2] for x in segments if x.size >= length]
        if sum(map(len, found)) >= 2 * LEAST_WINDOWS:
            return np.concatenate(found)
    return None


def _lines(values: FloatArray, length: int) -> list[float]:
    """The frequencies [cycles per sample] of the strongest lines after removal of a polynomial, strongest first."""
    longest = max((values[run] for run in runs(values)), key=len)
    size = min(longest.size, 8 * length)
    pieces = sliding_window_view(longest, size)[:: max(size // 2, 1)]
    taper = np.hanning(size)
    power = np.mean(np.abs(np.fft.rfft((pieces - pieces.mean(axis=1, keepdims=True)) * taper, 4 * size)) ** 2, axis=0)
    frequency = np.arange(power.size) / (4 * size)
    power[frequency < 1.5 / length] = 0.0
    found = []
    for _ in range(LINES[length]):
        best = float(frequency[int(np.argmax(power))])
        found.append(best)
        power[np.abs(frequency - best) < 1.0 / length] = 0.0
    return found


def _complement(length: int, lines: list[float]) -> FloatArray:
    """An orthonormal basis (L, L - p) of the complement of polynomials and growing or decaying lines."""
    t = np.linspace(-1, 1, length)
    columns = [t**order for order in range(TREND_ORDER + 1)]
    for line in lines:
        angle = np.pi * line * (length - 1) * t
        columns += [np.cos(angle), np.sin(angle), t * np.cos(angle), t * np.sin(angle)]
    full, _ = np.linalg.qr(np.column_stack(columns), "complete")
    return np.asarray(full[:, len(columns) :])


def _is_quiet(rest: FloatArray, free: FloatArray, correlation: float) -> np.ndarray:
    """Which windows are as quiet as the quietest quarter, if that is noise of this correlation."""
    power = np.mean(rest**2, axis=1)
    spread = np.linalg.eigvalsh(_covariance(free, correlation))
    relative = float(np.sqrt(2 * np.sum(spread**2)) / np.sum(spread))  # deviation of a window's variance over its mean
    ordered = np.sort(power)
    quarter = ordered[: max(int(QUIETEST * power.size), 4)].mean()
    usual = quarter / max(1 - 1.271 * relative, 0.2)  # mean of the lowest quarter of a normal variable
    return np.asarray(power <= max(usual * (1 + SURE * relative), ordered[3]))


def _covariance(free: FloatArray, correlation: float) -> FloatArray:
    lags = np.arange(free.shape[0])
    return np.asarray(free.T @ (correlation ** np.abs(lags[:, None] - lags)) @ free)


def _restricted(rest: FloatArray, free: FloatArray) -> tuple[float, float]:
    """The correlation of neighbouring samples and the stationary standard deviation with the largest restricted
    likelihood of projected windows (W, L - p)."""
    scores, deviations = [], []
    for correlation in CORRELATIONS:
        factor = np.linalg.cholesky(_covariance(free, correlation))
        white = np.linalg.solve(factor, rest.T)
        variance = max(float(np.mean(white**2)), 1e-300)
        size = white.size
        scores.append(-rest.shape[0] * np.sum(np.log(np.diag(factor))) - size / 2 * np.log(variance))
        deviations.append(np.sqrt(variance))
    white_at = int(np.argmin(np.abs(CORRELATIONS)))
    best = int(np.argmax(scores))
    if scores[best] - scores[white_at] < PREFERS_WHITE:
        return 0.0, float(deviations[white_at])
    return float(CORRELATIONS[best]), float(deviations[best])
