"""Spectra of a residual by Welch's method, and the frequency bands in which it exceeds the noise."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.special import chdtri

from lostmotion.lab import policy
from lostmotion.lab.data.autoregression import NoiseModel
from lostmotion.lab.data.series import runs
from lostmotion.model.motion import FloatArray

__all__ = ["Band", "Spectra", "spectra"]

SEGMENT = 2048
"""Largest length of a segment of Welch's method [samples]."""
LEAST_SEGMENT = 32
"""Its least length, where a recording is that long [samples]."""
BANDS_PER_OCTAVE = 2
"""Number of bands in an octave in which the error is reported."""


@dataclass(frozen=True)
class Band:
    """A frequency band with the root mean squares of residual, noise and signal within it; stands_out: whether the
    residual exceeds the noise significantly."""

    low_hz: float
    high_hz: float
    residual: float
    noise: float
    signal: float
    stands_out: bool


@dataclass(frozen=True, eq=False)
class Spectra:
    """One-sided power densities (F,) of signal, residual and noise [unit²/Hz] at frequency_hz (F,), and the bands."""

    frequency_hz: FloatArray
    signal: FloatArray
    residual: FloatArray
    noise: FloatArray
    bands: tuple[Band, ...]


def spectra(
    signals: Sequence[FloatArray], residuals: Sequence[FloatArray], rate_hz: float, noise: NoiseModel
) -> Spectra:
    """The spectra of a signal and its residual over all recordings, (N_i,) each with NaN as gaps, by Welch's method
    with half overlapping Hann windows; and the density of the noise model."""
    longest = max((run.stop - run.start for x in residuals for run in runs(x)), default=0)
    segment = max(min(SEGMENT, 1 << (max(longest // 4, 1).bit_length() - 1)), min(LEAST_SEGMENT, longest))
    frequency = np.asarray(np.fft.rfftfreq(segment, 1 / rate_hz))
    signal, _ = _welch(signals, segment, rate_hz)
    residual, averages = _welch(residuals, segment, rate_hz)
    density = noise.density(frequency, rate_hz)
    return Spectra(frequency, signal, residual, density, _bands(frequency, signal, residual, density, averages))


def _welch(series: Sequence[FloatArray], segment: int, rate_hz: float) -> tuple[FloatArray, float]:
    """The power density (F,), and the effective number of independent segments of which it is the mean."""
    taper = np.hanning(segment)
    pieces = [sliding_window_view(x[run], segment)[:: segment // 2] for x in series for run in runs(x)
              if run.stop - run.start >= segment]  # fmt: skip
    windows = np.concatenate(pieces)
    power = np.abs(np.fft.rfft((windows - windows.mean(axis=1, keepdims=True)) * taper)) ** 2
    density = 2 * power.mean(axis=0) / (rate_hz * float(taper @ taper))
    return density, max(0.53 * len(windows) + 0.5, 1.0)  # half overlapping Hann windows share data


def _bands(
    frequency: FloatArray, signal: FloatArray, residual: FloatArray, noise: FloatArray, averages: float
) -> tuple[Band, ...]:
    step, top = frequency[1], frequency[-1]
    octaves = np.log2(top / step)
    edges = step * 2 ** np.linspace(0, octaves, max(round(BANDS_PER_OCTAVE * octaves), 1) + 1)
    found = []
    for low, high in itertools.pairwise(edges):
        inside = (frequency >= low) & (frequency < high)
        bins = int(inside.sum())
        if not bins:
            continue
        left, floor, all_of_it = (float(np.sqrt(np.sum(d[inside]) * step)) for d in (residual, noise, signal))
        freedom = max(2 * averages * max(bins / 1.5, 1.0), 1.0)  # a Hann window smears a line over 1.5 bins
        limit = float(chdtri(freedom, policy.FALSE_LINE / (edges.size - 1))) / freedom
        found.append(Band(float(low), float(high), left, floor, all_of_it, left**2 > limit * floor**2))
    return tuple(found)
