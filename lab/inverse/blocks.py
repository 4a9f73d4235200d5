"""Blocks of correlated samples, each of which counts as one observation."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from lostmotion.model.motion import FloatArray

__all__ = ["correlation", "numbered"]


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
