"""Noise as an autoregressive process: fitted to healthy windows, whitened in others.  No oscillator here."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.fft import rfft  # imported at the start, as later there may be no memory
from numpy.lib.stride_tricks import sliding_window_view

from lostmotion.detector.errors import DetectorError
from lostmotion.detector.window import FloatArray

__all__ = ["MOST_ORDER", "Noise", "fit_noise", "levinson", "rounded", "spectrum", "unwhitener", "whiten", "whitener"]

LEAST_LENGTH = 16
ROUNDS = 8
DIGITS = 4
MOST_ORDER = 64
"""At a kilohertz as many are needed to resolve a bar's own hum."""


@dataclass(frozen=True, slots=True)
class Noise:
    """deviation: standard deviation of the one-step prediction error; colour: reflection coefficients."""

    deviation: float
    colour: tuple[float, ...]


def fit_noise(windows: FloatArray, slow: FloatArray) -> Noise:
    """An autoregressive model of the noise in windows, shape (M, N), with unknown slow motion.

    slow: orthonormal basis of the motion, shape (N, P).  The noise in its span is not observed: it is replaced by its
    expectation under the model, and the model is fitted again (Dempster, Laird and Rubin 1977), beginning with white
    noise.  Each model is that of the mean autocovariances (Levinson's recursion); its order, at most a third of N and
    64, has the least Bayesian information criterion.  Raises DetectorError for windows that are too short or have
    holes.
    """
    length, lost = slow.shape
    if windows.ndim != 2 or windows.shape[1] != length or length < LEAST_LENGTH or not np.all(np.isfinite(windows)):
        raise DetectorError(f"windows of shape {windows.shape}; expected several of at least {LEAST_LENGTH} samples")
    seen = np.linalg.qr(slow, mode="complete")[0][:, lost:]
    projected = windows @ seen
    power = projected.T @ projected / len(projected)
    most = min(length // 3, MOST_ORDER)
    covariance = np.full(most + 1, 0.0)
    covariance[0] = np.trace(power) / (length - lost)
    noise = Noise(math.sqrt(covariance[0]), ())
    for _ in range(ROUNDS):
        model = _covariance(noise, length)
        gain = np.linalg.solve(seen.T @ model @ seen, seen.T @ model).T
        whole = gain @ power @ gain.T + model - gain @ (seen.T @ model)
        covariance = np.array([np.trace(whole, lag) / (length - lag) for lag in range(most + 1)])
        noise = levinson(covariance, len(windows) * (length - lost))
    return noise


def levinson(covariance: FloatArray, count: float) -> Noise:
    """The model of the order with the least criterion for autocovariances from ``count`` samples."""
    error, weights, colour = float(covariance[0]), np.ones(1), list[float]()
    criterion, best = 0.0, Noise(math.sqrt(error), ())
    least = 0.0
    for order in range(1, covariance.size):
        reflection = -float(weights @ covariance[order:0:-1]) / error
        if abs(reflection) >= 1:  # means over few products may not be a valid autocovariance
            break
        padded = np.append(weights, 0.0)
        weights = padded + reflection * padded[::-1]
        error *= 1 - reflection**2
        colour.append(reflection)
        criterion += count * math.log1p(-(reflection**2)) + math.log(count)
        if criterion < least:
            least, best = criterion, Noise(math.sqrt(error), tuple(colour))
    return best


def rounded(noise: Noise) -> Noise:
    """The noise rounded to few digits: four significant ones of the deviation and of 1 - |k| of each reflection
    coefficient k.

    A coefficient close to ±1 thus stays inside of them, which a stable process needs, and keeps its peak's height.
    """
    decimals = [DIGITS - 1 - math.floor(math.log10(1 - abs(reflection))) for reflection in noise.colour]
    colour = tuple(round(reflection, places) for reflection, places in zip(noise.colour, decimals, strict=True))
    return Noise(float(f"{noise.deviation:.{DIGITS}g}"), colour)


def spectrum(noise: Noise, points: int) -> FloatArray:
    """Power of the process at ``points`` + 1 even frequencies from 0 to half of the rate; the mean over all, also the
    negative ones, is its variance."""
    taps = _filters(noise.colour)[-1, ::-1]
    return np.asarray(noise.deviation**2 / np.abs(rfft(taps, 2 * points)) ** 2)


def _covariance(noise: Noise, length: int) -> FloatArray:
    """Covariance (length, length) of the process, from the inverse of ``whiten``."""
    root = unwhitener(length, noise.colour) * noise.deviation
    return np.asarray(root @ root.T)


def whiten(values: FloatArray, reflections: Sequence[float]) -> FloatArray:
    """One-step prediction errors, scaled to the same variance; shape (..., N) kept.

    The prediction-error filter of the reflection coefficients (Levinson's recursion); the first samples are predicted
    from the fewer before them, and scaled to the same variance, so noise of that model is white from the first sample
    on.
    """
    whole = np.array(values, dtype=float, order="C")
    if not reflections:
        return whole
    filters = _filters(tuple(reflections))
    order, length = len(reflections), whole.shape[-1]
    begin = min(order, length)
    head = whole[..., :begin] @ filters[:begin, :begin].T
    if length > order:
        taps = filters[order, ::-1]
        for row in whole.reshape(-1, length):
            row[order:] = np.convolve(row, taps, mode="valid")
    whole[..., :begin] = head
    return whole


def whitener(length: int, reflections: Sequence[float]) -> FloatArray:
    """The same as a lower triangular matrix, shape (length, length): ``whiten(v)`` is its product with v."""
    filters = _filters(tuple(reflections))
    order = min(len(reflections), length - 1)
    matrix = np.zeros((length, length))
    matrix[: order + 1, : order + 1] = filters[: order + 1, : order + 1]
    later = np.arange(length - order)[:, None]
    matrix[order + later, later + np.arange(order + 1)] = filters[order, : order + 1]
    return matrix


def unwhitener(length: int, reflections: Sequence[float]) -> FloatArray:
    """The inverse of ``whitener``, shape (length, length), in a quarter of the time that a general one takes.

    Below the first P rows ``whitener`` is one filter, shifted, so the inverse's columns behind the first P are its
    impulse response, shifted; the first P rows are those of the inverse of their own part.
    """
    filters = _filters(tuple(reflections))
    order = min(len(reflections), length - 1)
    taps, response = filters[order, :order], np.zeros(2 * length - 1)
    for n in range(length - 1, 2 * length - 1):
        before = response[n - order : n] if order else response[:0]
        response[n] = ((n == length - 1) - taps @ before) / filters[order, order]
    matrix = np.array(sliding_window_view(response, length)[:, ::-1])
    if order:
        head = np.linalg.inv(filters[:order, :order])
        matrix[:order, :order] = head
        matrix[order:, :order] = -matrix[order:, order:] @ (whitener(length, reflections)[order:, :order] @ head)
    return matrix


@lru_cache(maxsize=16)
def _filters(reflections: tuple[float, ...]) -> FloatArray:
    """Prediction-error filters of orders 0 to P, shape (P + 1, P + 1): row k gives the error of sample k from samples 0
    to k, all scaled to the error of order P."""
    filters = np.eye(len(reflections) + 1)
    for order, reflection in enumerate(reflections):
        weights = filters[order, : order + 1]
        filters[order + 1, 1 : order + 2] = weights
        filters[order + 1, : order + 1] += reflection * weights[::-1]
        filters[: order + 1] *= math.sqrt(1 - reflection**2)
    return filters
