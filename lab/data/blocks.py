"""Blocks of correlated samples, each of which counts as one observation, and the test of two models' errors on them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtr

from lostmotion.lab import policy
from lostmotion.model.motion import FloatArray

__all__ = ["chance", "correlation", "floored", "numbered"]


def numbered(counts: Sequence[int], length: float) -> NDArray[np.intp]:
    """The number of each sample's block (M,), for blocks of about this length [samples] that do not cross
    recordings."""
    numbers, first = [], 0
    for count in counts:
        many = max(round(count / max(length, 1.0)), 1)
        numbers.append(first + np.arange(count) * many // count)
        first += many
    return np.concatenate(numbers)


def correlation(residual: FloatArray) -> float:
    """Integral correlation time in samples: 1 + 2 sum of the autocorrelation up to its first zero."""
    centred = residual - residual.mean()
    power = np.abs(np.fft.rfft(centred, 2 * centred.size)) ** 2
    raw = np.fft.irfft(power)[: centred.size // 2]
    if not raw[0] > 0:
        return 1.0
    own = raw / raw[0]
    zero = np.flatnonzero(own <= 0)
    return float(1 + 2 * own[1 : zero[0] if zero.size else None].sum())


def chance(before: FloatArray, after: FloatArray, block: NDArray[np.intp]) -> float:
    """The p-value of the t-test of the mean logarithm of two models' squared errors (M,), block (M,) by block."""
    ratio = 0.5 * np.log(floored(before, after, block) / floored(after, after, block))
    spread = float(ratio.std(ddof=1)) / np.sqrt(ratio.size)
    return float(stdtr(ratio.size - 1, -ratio.mean() / max(spread, 1e-12)))


def floored(squares: FloatArray, usual: FloatArray, block: NDArray[np.intp]) -> FloatArray:
    """The sums of squared errors (M,) in each block, none below the least share of the usual ones (M,) that counts.

    Errors below the least share that counts for the whole are equal in a block, too: a model that is accurate to a
    fifth elsewhere is not accurate to a thousandth there.  Two constants, Coulomb friction and bias, fit a motor at
    constant voltage and speed exactly, and blocks with nothing but noise, 1e-4 of the torque, outvoted all others.
    """
    floor = (policy.LEAST_GAIN * float(usual.mean()) + 1e-300) * np.bincount(block)
    return np.asarray(np.bincount(block, squares) + floor)
