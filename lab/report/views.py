"""What the report draws, whatever it was computed by: one recorded column against the model, its spectra, its maps.

Only rearranged here: results of the lab come in, arrays in SI units that belong together come out.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from lostmotion.lab import words
from lostmotion.lab.predict import predict
from lostmotion.lab.results import Fit
from lostmotion.model import Trajectory
from lostmotion.model.motion import FloatArray

__all__ = ["Overlay", "Spectra", "overlays", "spectra"]

LEAST_SAMPLES = 16
SEGMENTS = 8
"""At least so many half-overlapping stretches are averaged in a spectrum."""


@dataclass(frozen=True, eq=False)
class Overlay:
    """One column of one recording: times [s], measured and modelled, (N,) each without gaps; the noise's rms or NaN.

    before: (N,) of the model without the effects that were found; None where there is no such model.
    """

    recording: str
    column: str
    time: FloatArray
    measured: FloatArray
    modelled: FloatArray
    noise: float
    before: FloatArray | None = None

    @property
    def what(self) -> str:
        """What the column is: "acceleration"."""
        return words.column(self.column)[0]

    @property
    def unit(self) -> str:
        """Its SI unit."""
        return words.column(self.column)[1]

    @property
    def residual(self) -> FloatArray:
        """Measured minus modelled (N,)."""
        return self.measured - self.modelled


@dataclass(frozen=True, eq=False)
class Spectra:
    """Amplitude densities [unit/√Hz] of one column over frequency [Hz], (K,) each; noise is white."""

    overlay: Overlay
    frequency: FloatArray
    measured: FloatArray
    modelled: FloatArray
    residual: FloatArray
    noise: float


def overlays(fit: Fit, before: Fit | None = None) -> Iterator[Overlay]:
    """Each column of each experiment against the fitted model, and against the one before it was improved."""
    earlier = tuple(_trajectories(before)) if before else (None,) * len(fit.experiments)
    for experiment, now, then in zip(fit.experiments, _trajectories(fit), earlier, strict=True):
        for column, measured in experiment.measured.items():
            there = ~np.isnan(measured)
            yield Overlay(
                experiment.name, column, experiment.time[there], measured[there], now[column][there],
                fit.noise.get(column, math.nan), then[column][there] if then else None,
            )  # fmt: skip


def _trajectories(fit: Fit) -> Iterator[Trajectory]:
    for experiment, start in zip(fit.experiments, fit.starts, strict=True):
        yield predict(fit.model, experiment, start, substep_s=fit.substep_s).trajectory


def spectra(overlay: Overlay) -> Spectra | None:
    """Averaged over stretches with half overlap (Welch, Hann window); None for a few samples.

    Samples that are not evenly spaced are interpolated onto the median spacing first.
    """
    from scipy.signal import welch

    if overlay.time.size < LEAST_SAMPLES:
        return None
    spacing = float(np.median(np.diff(overlay.time)))
    even = np.arange(overlay.time[0], overlay.time[-1] + spacing / 2, spacing)
    length = max(min(even.size, 2 * even.size // (SEGMENTS + 1)), LEAST_SAMPLES)
    signals = [np.interp(even, overlay.time, v) for v in (overlay.measured, overlay.modelled, overlay.residual)]
    frequency, density = welch(np.array(signals), fs=1 / spacing, nperseg=length, detrend="constant")
    measured, modelled, residual = np.sqrt(density[:, 1:])
    floor = overlay.noise * math.sqrt(2 * spacing)
    return Spectra(overlay, frequency[1:], measured, modelled, residual, floor)
