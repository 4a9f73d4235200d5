"""The part of an impact that rings do not explain, separated from the noise: no impact is a single impulse.

Teeth separate gradually, stay in contact for some milliseconds, bounce, and vibrate on each other.  All of it moves the
bar's foot, and the bar responds.  docs/decisions/0005-ringdown.md has the measurements.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from lostmotion.detector import ringdown
from lostmotion.detector.window import DetectorSettings, FloatArray

__all__ = ["Split", "directions", "split"]

SHARES = np.array([0.0, 0.003, 0.01, 0.03, 0.1, 0.3])
"""Energies of the misfit over that of the rings, with equal prior probabilities (Jeffreys' prior of a scale).  Of eq.
1's gears it is 0.03 to 0.2, 0.1 in the mean; of hard stops 0.02."""
STEPS, RANK = 8, 30
"""Steps of the foot's acceleration in a period, and how many principal directions of the response are kept: of windows
of 0.25 s the last one has 1 % of the energy of the first."""


class Split(NamedTuple):
    """gain: ln of the likelihood ratio of each window to one without misfit, (M,); noise: rows (M, N) whose outer
    products are the expected ones of the noise in the residuals; hidden: the part of it that the misfit hides, for
    noise of unit variance, summed over the windows, (N, N)."""

    gain: FloatArray
    noise: FloatArray
    hidden: FloatArray


@lru_cache(maxsize=4)
def directions(length: int, rate_hz: float, settings: DetectorSettings) -> FloatArray:
    """The response of a bar whose foot has a white acceleration, without slow motion: orthogonal columns, shape (N, R),
    in the order of their energy."""
    slow = np.linalg.qr(ringdown.slow_motion(length, rate_hz, settings))[0]
    time = np.arange(length) / rate_hz
    begins = np.arange(0.0, time[-1], 1 / (STEPS * settings.f_res_hz))
    rings = ringdown.ring((time[:, None] - begins).ravel(), settings)[:, 1].reshape(length, begins.size)
    basis, size, _ = np.linalg.svd(rings - slow @ (slow.T @ rings), full_matrices=False)
    return np.asarray(basis[:, :RANK] * size[:RANK])


def split(
    left: FloatArray, bases: FloatArray, energy: FloatArray, weights: FloatArray, columns: FloatArray, variance: float
) -> Split:
    """The residual of rings in windows, shape (M, N), as noise of a variance and misfit, normal with the covariance
    that the columns (N, R) make of white amplitudes, scaled by its unknown share of the rings' energy, (M,).

    bases: of the rings, orthonormal rows, (M, S, N), or zero; weights: of each window, (M,).  The posterior mean and
    covariance of the noise in the columns' directions, averaged over the shares: with v = variance and a misfit of
    variance s in a direction of amplitude a they are a v / (v + s) and v s / (v + s).
    """
    inside = bases @ columns
    power, turn = np.linalg.eigh(columns.T @ columns - inside.transpose(0, 2, 1) @ inside)
    power = np.maximum(power, ringdown.DUST * power[:, -1:])
    amplitudes = (((left @ columns)[:, None] @ turn)[:, 0]) / np.sqrt(power)
    even = power / power.sum(axis=1, keepdims=True)
    kept = 1 / (1 + (SHARES[:, None] * energy / variance)[:, :, None] * even)
    evidence = np.sum(np.log(kept) + (1 - kept) * amplitudes**2 / variance, axis=2) / 2
    top = evidence.max(axis=0)
    odds = np.exp(evidence - top) / SHARES.size
    gain = top + np.log(odds.sum(axis=0))
    odds /= odds.sum(axis=0)
    mean, square = (np.sum(odds[:, :, None] * part, axis=0) for part in (kept, kept**2))
    change = (turn @ ((np.sqrt(square) - 1) * amplitudes / np.sqrt(power))[:, :, None])[:, :, 0]
    noise = left + change @ columns.T - ((inside @ change[:, :, None]).transpose(0, 2, 1) @ bases)[:, 0]
    spread = (turn * (weights[:, None] * (1 - mean) / power)[:, None]) @ turn.transpose(0, 2, 1)
    return Split(gain, noise, _projected(spread, inside, bases, columns))


def _projected(spread: FloatArray, inside: FloatArray, bases: FloatArray, columns: FloatArray) -> FloatArray:
    """The sum over windows of Y spread Yᵀ, Y = columns - basesᵀ inside, without forming any Y, (N, R) each."""
    across = inside @ spread
    rows = bases.reshape(-1, bases.shape[2])
    mixed = columns @ (across.reshape(len(rows), -1).T @ rows)
    within = (across @ inside.transpose(0, 2, 1)) @ bases
    whole = columns @ spread.sum(axis=0) @ columns.T - mixed - mixed.T + rows.T @ within.reshape(rows.shape)
    return np.asarray(whole)
