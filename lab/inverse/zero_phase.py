"""The low-pass filter that all signals of a regression pass: Butterworth, forwards and backwards, compiled."""

from __future__ import annotations

from functools import lru_cache, partial

import numpy as np
from numba import njit

from lostmotion.model.kernel import OPTIONS, compiled
from lostmotion.model.motion import FloatArray

__all__ = ["lowpass"]

ORDER = 4
"""Order of the Butterworth filter, which runs forwards and backwards."""


def lowpass(values: FloatArray, band: float) -> FloatArray:
    """Filters values (..., N) along the last axis without a phase shift; band: the cutoff in cycles per sample.

    As ``scipy.signal.sosfiltfilt`` does, which takes 0.20 ms for 1250 samples where this takes 0.04, and 0.01 for each
    of eight signals together (two calls of ``sosfilt`` without padding: 0.08 and 0.04): a search of a joint's torque
    filters some twenty thousand such signals.
    """
    sections, settled = _butterworth(band)
    padding = min(values.shape[-1] - 1, round(3 / band))
    rows = np.moveaxis(values, -1, 0)
    before, after = 2 * rows[:1] - rows[padding:0:-1], 2 * rows[-1:] - rows[-2 : -padding - 2 : -1]
    padded = np.concatenate([before, rows, after])
    columns = padded.reshape(len(padded), -1)  # views
    _filter(columns, sections, settled)
    _filter(columns[::-1], sections, settled)
    return np.ascontiguousarray(np.moveaxis(padded[padding : padding + len(rows)], 0, -1))


@lru_cache(maxsize=64)
def _butterworth(band: float) -> tuple[FloatArray, FloatArray]:
    """Second-order sections (S, 6), and their steady state (S, 2) for a constant input of one."""
    from scipy.signal import butter, sosfilt_zi  # late, as everywhere in the lab: scipy.signal takes half a second

    sections = np.asarray(butter(ORDER, 2 * band, output="sos"))
    return sections, np.asarray(sosfilt_zi(sections))


def _sections(values: FloatArray, sections: FloatArray, settled: FloatArray) -> None:
    """Filters the columns of values (N, K) in place, transposed direct form II, from the steady state of the first
    row."""
    one, two = settled[:, :1] * values[0], settled[:, 1:] * values[0]
    for i in range(values.shape[0]):
        for section in range(sections.shape[0]):
            b0, b1, b2, a1, a2 = (
                sections[section, 0], sections[section, 1], sections[section, 2], sections[section, 4],
                sections[section, 5],
            )  # fmt: skip
            for k in range(values.shape[1]):
                x = values[i, k]
                y = b0 * x + one[section, k]
                one[section, k] = b1 * x - a1 * y + two[section, k]
                two[section, k] = b2 * x - a2 * y
                values[i, k] = y


_filter = compiled(partial(njit, nogil=True, **OPTIONS), _sections)
