"""The normalised spectrum of a window of tip acceleration: fft, freq_fft, norm and mask of eqs. 8 and 10.

Where the paper is silent, docs/decisions/0002-score.md has the choice and its measurement.  No level and no score here.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lostmotion.detector.errors import DetectorError
from lostmotion.detector.window import DetectorSettings, FloatArray

__all__ = ["Bands", "amplitudes", "bands", "freq_fft", "frequencies", "normalised_mask", "transform"]

TREND_ORDER = 3
"""Order of the polynomial removed from a window: a quarter of a second of arm motion below 3 Hz is at most a cubic."""
TAPER = 0.25
"""Share of the window in the two cosine slopes of the Tukey window."""
LEAST_NORM_BINS = 3
DUST = 3e-8
"""Share of the largest value below which the norm band's mean amplitude is not noise but rounding, as in a column
that is no acceleration.  Clocks have up to 2e-8 (in microseconds with 4 µs of jitter, after ten seconds) and 1.5e-8
(in milliseconds, after one second), a constant value has 1e-16; a noise of 1 mm/s² under gravity has 1.3e-5."""
EDGE = 1e-9
"""A band's edge that falls on a bin up to rounding is that bin."""


@dataclass(frozen=True, slots=True)
class Bands:
    """The bins of a spectrum of n samples that are used: mask [first, last) of eq. 10, and the bins of norm."""

    mask: slice
    norm: NDArray[np.intp]


def freq_fft(frequency_hz: float, length: int, rate_hz: float) -> float:
    """freq_fft of eq. 10: the (fractional) bin of a frequency in the spectrum of ``length`` samples."""
    return frequency_hz * length / rate_hz


def frequencies(length: int, rate_hz: float) -> FloatArray:
    """Frequency [Hz] of each bin, shape (length // 2 + 1,)."""
    return np.arange(length // 2 + 1, dtype=np.float64) * (rate_hz / length)


def transform(length: int, bins: NDArray[np.intp]) -> FloatArray:
    """A matrix that takes a window to some bins of its spectrum: to a real and an imaginary part of each in turn,
    shape (length, 2 × bins).

    A cubic is removed by least squares, a Tukey window of sum 2 is applied, and the Fourier sums are formed.  All of
    this is linear, and a dozen of a hundred bins are used: one product with this matrix costs less than an FFT and the
    steps before it.
    """
    from_edge = np.minimum(np.arange(length) + 0.5, length - 0.5 - np.arange(length)) / length
    taper = np.where(from_edge < TAPER / 2, 0.5 - 0.5 * np.cos(2 * np.pi * from_edge / TAPER), 1.0)
    fourier = np.exp(-2j * np.pi / length * np.outer(np.arange(length), bins)) * (taper * (2 / taper.sum()))[:, None]
    cubics, _ = np.linalg.qr(np.vander(np.linspace(-1, 1, length), min(TREND_ORDER, length - 1) + 1))
    return np.ascontiguousarray(fourier - cubics @ (cubics.T @ fourier)).view(np.float64)


def amplitudes(accel: FloatArray, to_bins: FloatArray) -> FloatArray:
    """Amplitude [m/s²] of each bin of a ``transform``, shape (..., bins), of windows of shape (..., N).

    A sine of amplitude A in the middle of a bin gives A there.
    """
    return np.abs((accel @ to_bins).view(np.complex128))


def bands(length: int, rate_hz: float, settings: DetectorSettings) -> Bands:
    """The bins of mask and norm for windows of ``length`` samples.

    Both bands are half-open, as eq. 10 has it: i in [freq_fft(f - width/2), freq_fft(f + width/2)).  The norm band ends
    below the Nyquist frequency, and bins of the mask do not count in it.

    Raises DetectorError when the mask or the norm band has no (or too few) bins at this rate and length.
    """
    return _chosen(length, rate_hz, _BandOptions.of(settings))


def _chosen(length: int, rate_hz: float, settings: _BandOptions) -> Bands:
    mask = _band(settings.f_res_hz, settings.f_width_hz, length, rate_hz)
    nyquist = rate_hz / 2
    if not 1 <= mask.start < mask.stop <= math.ceil(length / 2):
        raise DetectorError(
            f"the mask {_range(settings.f_res_hz, settings.f_width_hz)} holds no bin, or reaches beyond what {length} "
            f"samples at {rate_hz:g} Hz resolve ({rate_hz / length:.3g} to {nyquist:g} Hz); "
            "likely the sensor is too slow for this oscillator, or f_width_hz or window_s is too small"
        )
    wanted = _band(settings.f_norm_hz, settings.f_norm_width_hz, length, rate_hz)
    inside = np.arange(max(wanted.start, 1), min(wanted.stop, math.ceil(length / 2)))
    norm = inside[(inside < mask.start) | (inside >= mask.stop)]
    if norm.size < LEAST_NORM_BINS:
        raise DetectorError(
            f"the norm band {_range(settings.f_norm_hz, settings.f_norm_width_hz)} has {norm.size} bins beside the "
            f"mask and below {nyquist:g} Hz, the highest frequency at {rate_hz:g} samples a second; expected at least "
            f"{LEAST_NORM_BINS}: lower f_norm_hz, widen f_norm_width_hz or raise the sensor's rate"
        )
    return Bands(mask, norm)


def normalised_mask(accel: FloatArray, rate_hz: float, settings: DetectorSettings) -> FloatArray:
    """norm(fft(s)) of eq. 8 at the bins of the mask: each amplitude over the mean amplitude of the norm band; NaN where
    that mean is rounding (``DUST``), or overflows.

    accel: windows [m/s²], shape (..., N); returns shape (..., bins of the mask).  Raises DetectorError as ``bands``
    does.
    """
    to_bins, inside = _to_bands(accel.shape[-1], rate_hz, _BandOptions.of(settings))
    with np.errstate(over="ignore", invalid="ignore"):
        spectrum = amplitudes(accel, to_bins)
        floor = spectrum[..., inside:].sum(axis=-1, keepdims=True) / (spectrum.shape[-1] - inside)
        dust = DUST * np.abs(accel).max(axis=-1, keepdims=True)
        return np.asarray(spectrum[..., :inside] / np.where((floor > dust) & (floor < np.inf), floor, np.nan))


class _BandOptions(NamedTuple):
    """The settings that bands depend on, as a cache key that a new noise does not change."""

    f_res_hz: float
    f_width_hz: float
    f_norm_hz: float
    f_norm_width_hz: float

    @classmethod
    def of(cls, settings: DetectorSettings) -> _BandOptions:
        return cls(settings.f_res_hz, settings.f_width_hz, settings.f_norm_hz, settings.f_norm_width_hz)


@lru_cache(maxsize=64)
def _to_bands(length: int, rate_hz: float, options: _BandOptions) -> tuple[FloatArray, int]:
    """The ``transform`` to the bins of the mask and then to those of the norm; how many are the mask's."""
    chosen = _chosen(length, rate_hz, options)
    mask = np.arange(chosen.mask.start, chosen.mask.stop)
    return transform(length, np.concatenate((mask, chosen.norm))), mask.size


def _band(centre_hz: float, width_hz: float, length: int, rate_hz: float) -> slice:
    low, high = (freq_fft(centre_hz + side * width_hz / 2, length, rate_hz) for side in (-1, 1))
    return slice(math.ceil(low - EDGE), math.ceil(high - EDGE))


def _range(centre_hz: float, width_hz: float) -> str:
    return f"{centre_hz - width_hz / 2:g}-{centre_hz + width_hz / 2:g} Hz"
