"""Noise of unit white part in windows, several kinds; and its covariance, which only the bounds may know."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

__all__ = ["KINDS", "covariance", "draw"]

FloatArray = NDArray[np.float64]
KINDS = ("white", "coloured", "hum", "fan", "shaken")
LEARNT = 20_000
"""Windows from which the bounds learn a covariance."""


def draw(rng: np.random.Generator, kind: str, count: int, length: int, rate_hz: float, f_res_hz: float) -> FloatArray:
    """Windows of noise, shape (count, length).

    white; coloured: with a first-order part, 1.5 times as loud, below 11 Hz; hum: mains at 50 Hz, twice as loud;
    fan: a line that wanders 5 Hz above the resonance, twice as loud; shaken: the bar shaken by a rough gear, as loud.
    """
    white = rng.normal(size=(count, length))
    time = np.arange(length) / rate_hz
    phase = rng.uniform(0, 2 * math.pi, (count, 1))
    if kind == "coloured":
        return white + 1.5 * _filtered(rng, count, length, complex(math.exp(-2 * math.pi * 11 / rate_hz), 0.0))
    if kind == "hum":
        return np.asarray(white + 2 * math.sqrt(2) * np.sin(2 * math.pi * 50.02 * time + phase))
    if kind == "fan":
        turn = 2 * math.pi * rng.normal(f_res_hz + 5, 0.5, (count, 1))
        return np.asarray(white + 2 * math.sqrt(2) * np.sin(turn * time + phase))
    if kind == "shaken":
        omega = 2 * math.pi * f_res_hz / rate_hz
        pole = np.exp(complex(-0.012, 1) * omega)
        return white + math.sqrt(2) * _filtered(rng, count, length, complex(pole))
    return white


def covariance(kind: str, length: int, rate_hz: float, f_res_hz: float) -> FloatArray:
    """Covariance (length, length) of one kind, averaged along its diagonals: the noise is stationary."""
    if kind == "white":
        return np.eye(length)
    noise = draw(np.random.default_rng(99), kind, LEARNT, length, rate_hz, f_res_hz)
    matrix = noise.T @ noise / LEARNT
    lags = np.array([np.trace(matrix, lag) / (length - lag) for lag in range(length)])
    toeplitz = lags[np.abs(np.subtract.outer(np.arange(length), np.arange(length)))]
    values, vectors = np.linalg.eigh(toeplitz)
    return np.asarray((vectors * np.maximum(values, 0.5)) @ vectors.T)


def _filtered(rng: np.random.Generator, count: int, length: int, pole: complex) -> FloatArray:
    """The real part of stationary first-order noise of unit variance (complex pole: half of it)."""
    from scipy.signal import lfilter

    turns = bool(pole.imag)
    innovations, before = rng.normal(size=(count, length)).astype(complex), rng.normal(size=(count, 1)).astype(complex)
    if turns:
        innovations, before = ((one + 1j * rng.normal(size=one.shape)) / math.sqrt(2) for one in (innovations, before))
    moved, _ = lfilter([math.sqrt(1 - abs(pole) ** 2)], [1, -pole], innovations, axis=1, zi=pole * before)
    return np.asarray(moved.real)
