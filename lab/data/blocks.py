"""Blocks of correlated samples, each of which counts as one observation, and the test of two models' errors on them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtr

from lostmotion.lab import policy
from lostmotion.model.motion import FloatArray

__all__ = ["chance", "correlation", "family_wise", "floored", "numbered"]

SIGNS = 4096
"""Draws of the signs of all blocks, the number of all assignments for twelve of them."""


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
    """The p-value of the t-test of the mean logarithm of two models' squared errors (M,), block (M,) by block; 1 where
    there is one block only, and 0 where the errors before are infinite, as those of a motion that cannot be
    simulated."""
    if np.isinf(before).all() and np.isfinite(after).all():
        return 0.0
    ratio = _log_ratios(before, after, block)
    if ratio.size < 2:
        return 1.0
    spread = float(ratio.std(ddof=1)) / np.sqrt(ratio.size)
    return float(stdtr(ratio.size - 1, -ratio.mean() / max(spread, 1e-12)))


def family_wise(
    errors: Sequence[tuple[FloatArray, FloatArray]], counts: Sequence[float], block: NDArray[np.intp], level: float
) -> float:
    """The factor of p-values that are multiplied by ``counts`` already, for which one of the tests is significant with
    the probability ``level`` where no second model predicts better: 1 for independent tests with sum(1 / counts) = 1
    (Bonferroni), less where the same blocks favour similar models.

    errors: the squared errors of two models (M,), before and after, for each test; block (M,), the same for all.  The
    logarithm of the ratio of a block is then as often positive as negative.  With random signs of the blocks, the same
    for all tests, the smallest of the multiplied p-values has a quantile q at ``level``, and the factor is level / q
    (single-step min-p: Westfall and Young 1993, "Resampling-based multiple testing", 2.3).
    """
    ratios = np.array([_log_ratios(before, after, block) for before, after in errors])
    blocks = ratios.shape[1]
    if blocks < 2:
        return 1.0
    rng = np.random.default_rng(0)
    drawn = (rng.choice((-1.0, 1.0), (SIGNS // 16, blocks)) for _ in range(16))  # 3000 blocks take 6 MB at once
    mean = np.concatenate([signs @ ratios.T for signs in drawn]) / blocks
    spread = np.sqrt(np.maximum(np.mean(ratios**2, axis=1) - mean**2, 1e-24) / (blocks - 1))
    least = np.min(np.asarray(counts) * stdtr(blocks - 1, -mean / spread), axis=1)
    return float(min(level / np.quantile(least, level), 1.0))


def _log_ratios(before: FloatArray, after: FloatArray, block: NDArray[np.intp]) -> FloatArray:
    """Half the logarithms of the ratio of two models' squared errors, block by block."""
    return np.asarray(0.5 * np.log(floored(before, after, block) / floored(after, after, block)))


def floored(squares: FloatArray, usual: FloatArray, block: NDArray[np.intp]) -> FloatArray:
    """The sums of squared errors (M,) in each block, none below the least share of the usual ones (M,) that counts.

    Errors below the least share that counts for the whole are equal in a block, too: a model that is accurate to a
    fifth elsewhere is not accurate to a thousandth there.
    """
    floor = (policy.LEAST_GAIN * float(usual.mean()) + 1e-300) * np.bincount(block)
    return np.asarray(np.bincount(block, squares) + floor)
