"""Noise as an autoregressive process: fitted to healthy windows, undone in others.  Knows no oscillator."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lostmotion.detector.errors import DetectorError
from lostmotion.detector.window import FloatArray

__all__ = ["fit_noise", "whiten"]

LEAST_LENGTH = 16
MOST_ORDER = 32
"""A kilohertz needs as many to tell a bar's own hum from the noise around it."""


def fit_noise(windows: FloatArray, most: int | None = None) -> tuple[float, ...]:
    """Reflection coefficients of an autoregressive model of the windows, shape (M, N), one set for all.

    Burg's method (1975), pooled over the windows; the order, at most ``most`` (a third of N, at most 32), has the least
    Bayesian information criterion.  White noise gives (); every |k| < 1, so the model is stable whatever the windows.
    """
    count = windows.size
    if windows.ndim != 2 or windows.shape[1] < LEAST_LENGTH or not np.all(np.isfinite(windows)):
        raise DetectorError(f"windows of shape {windows.shape}; expected several of at least {LEAST_LENGTH} samples")
    most = most or min(windows.shape[1] // 3, MOST_ORDER)
    forward = backward = windows - windows.mean(axis=1, keepdims=True)
    power = float(np.mean(forward**2))
    best, chosen, found = 0.0, 0, list[float]()
    criterion = 0.0
    for order in range(1, most + 1):
        ahead, behind = forward[:, 1:], backward[:, :-1]
        reflection = -2 * float(np.sum(ahead * behind)) / max(float(np.sum(ahead**2 + behind**2)), 1e-300)
        found.append(reflection)
        forward, backward = ahead + reflection * behind, behind + reflection * ahead
        criterion += count * float(np.log1p(-(reflection**2))) + float(np.log(count))
        if power and criterion < best:
            best, chosen = criterion, order
    return tuple(found[:chosen])


def whiten(values: FloatArray, reflections: Sequence[float]) -> FloatArray:
    """What cannot be foretold from the samples before, scaled to the noise's one-step error; shape (..., N) kept.

    The lattice filter of the reflection coefficients; the first samples are foretold from the fewer that there are, and
    scaled up to the same variance, so white noise of that model comes out white from the first sample on.
    """
    forward = np.array(values, dtype=float)
    backward = forward.copy()
    scale = np.ones(values.shape[-1])
    for order, reflection in enumerate(reflections):
        ahead, behind = forward[..., order + 1 :].copy(), backward[..., order:-1].copy()
        forward[..., order + 1 :] = ahead + reflection * behind
        backward[..., order + 1 :] = behind + reflection * ahead
        scale[: order + 1] *= np.sqrt(1 - reflection**2)
    return forward * scale
