"""Statistics that the detector is held against: what one takes from a textbook of vibration monitoring, and the bounds.

All get windows, shape (M, N), whose slow motion has been taken out, and give (M,); larger means worn.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["CLASSICS", "average_likelihood", "envelope_line"]

FloatArray = NDArray[np.float64]
BAND = 0.2
"""Half-width of the band that is demodulated, as a share of f_res."""


def peak(windows: FloatArray) -> FloatArray:
    """The largest magnitude."""
    return np.abs(windows).max(axis=1)


def rms(windows: FloatArray) -> FloatArray:
    """Root mean square."""
    return np.asarray(np.sqrt(np.mean(windows**2, axis=1)))


def kurtosis(windows: FloatArray) -> FloatArray:
    """Fourth moment over the second squared."""
    return np.asarray(np.mean(windows**4, axis=1) / np.mean(windows**2, axis=1) ** 2)


def crest(windows: FloatArray) -> FloatArray:
    """Peak over root mean square."""
    return peak(windows) / rms(windows)


def envelope_line(windows: FloatArray, rate_hz: float, f_res_hz: float) -> FloatArray:
    """Envelope spectrum: the highest line but DC of the envelope of the band around f_res."""
    length = windows.shape[1]
    frequency = np.arange(length) * rate_hz / length
    inside = np.abs(frequency - f_res_hz) < BAND * f_res_hz
    envelope = np.abs(np.fft.ifft(np.where(inside, np.fft.fft(windows, axis=1), 0), axis=1))
    return np.abs(np.fft.rfft(envelope, axis=1))[:, 1:8].max(axis=1)


CLASSICS = {"peak": peak, "rms": rms, "kurtosis": kurtosis, "crest factor": crest}


def average_likelihood(white: FloatArray, library: FloatArray, size: float) -> FloatArray:
    """ln of the mean over true waveforms of other motions of their likelihood ratios: knows all but when.

    white: whitened windows; library: whitened waveforms of unit energy, (L, N); size: root of their true energy.
    """
    logs = size * (white @ library.T) - size**2 / 2
    top = logs.max(axis=1)
    return np.asarray(top + np.log(np.mean(np.exp(logs - top[:, None]), axis=1)))
