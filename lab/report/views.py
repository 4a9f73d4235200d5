"""The data of plots over time and frequency: each measured column with the modelled one, and their spectra.

They come from a comparison or, where there is none, from the simulation of a fit.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import PurePath

import numpy as np

from lostmotion.lab import words
from lostmotion.lab.comparison.compare import Comparison
from lostmotion.lab.comparison.residual_analysis import Prediction, predict
from lostmotion.lab.comparison.torque import needed_torques
from lostmotion.lab.data.experiment import Experiment
from lostmotion.lab.inverse.channel import Channel
from lostmotion.lab.results import Displayed, Explanation, Fit, Ladder
from lostmotion.model.motion import FloatArray

__all__ = ["Amplitudes", "Trace", "amplitudes", "before", "traces", "traces_of"]

LEAST_SAMPLES = 16
"""Least number of samples for a spectrum."""
SEGMENTS = 8
"""At least so many half-overlapping segments are averaged in a spectrum."""


@dataclass(frozen=True, eq=False)
class Trace:
    """One column of one recording.

    time [s], measured, modelled: (N,) each, without gaps; noise: its root mean square, or NaN; before: modelled without
    the missing effects (N,), None where there are none; is_linear, drive: see ``words.column``.
    """

    recording: str
    column: str
    time: FloatArray
    measured: FloatArray
    modelled: FloatArray
    noise: float
    before: FloatArray | None = None
    is_linear: bool = False
    drive: str = ""

    @property
    def what(self) -> str:
        """The quantity in the column: "acceleration"."""
        return words.column(self.column, self.is_linear, self.drive)[0]

    @property
    def unit(self) -> str:
        """Its SI unit."""
        return words.column(self.column, self.is_linear, self.drive)[1]

    @property
    def title(self) -> str:
        """The quantity, and the file name of the recording."""
        return f"{self.what}, {PurePath(self.recording).name}"

    @property
    def residual(self) -> FloatArray:
        """Measured minus modelled (N,)."""
        return self.measured - self.modelled


@dataclass(frozen=True, eq=False)
class Amplitudes:
    """Amplitude densities of a trace [unit/√Hz] at frequencies [Hz], (K,) each; noise: NaN where it is not known."""

    trace: Trace
    frequency: FloatArray
    measured: FloatArray
    modelled: FloatArray
    residual: FloatArray
    noise: FloatArray


def traces(fit: Fit | None, comparison: Comparison | None = None, before: Fit | None = None) -> Iterator[Trace]:
    """The traces of a comparison, or else of a fit; before: the fit without the missing effects."""
    then: list[Prediction] | None = None
    now: list[Mapping[str, FloatArray]]
    if comparison:
        experiments, noise = comparison.experiments, {name: one.noise.rms for name, one in comparison.columns.items()}
        in_order = iter(comparison.overlays)
        now = [{column: next(in_order).modelled for column in one.measured} for one in experiments]
    elif fit:
        noise, run = dict(fit.noise), _run(fit)
        experiments, now = tuple(one.experiment for one in run), [one.trajectory.signals for one in run]
        then = _run(before) if before and _same(before.experiments, fit.experiments) else None
    else:
        return
    for i, experiment in enumerate(experiments):
        for column, measured in experiment.measured.items():
            there = ~np.isnan(measured)
            yield Trace(
                experiment.name, column, experiment.time[there], measured[there], now[i][column][there],
                noise.get(column, math.nan), _beside(measured, then[i], column)[there] if then else None,
                experiment.is_linear, experiment.drive_unit,
            )  # fmt: skip


def _beside(measured: FloatArray, then: Prediction, column: str) -> FloatArray:
    """The signal of another fit (N,), counted from the zero of these measured values: each fit has zeros of its own."""
    return measured - (then.experiment.measured[column] - then.trajectory[column])


def traces_of(found: Displayed) -> tuple[Trace, ...]:
    """The traces of any result of the lab."""
    if isinstance(found, Comparison):
        return tuple(traces(None, found))
    if isinstance(found, Fit):
        return tuple(traces(found))
    explanation = found.last if isinstance(found, Ladder) else found
    assert isinstance(explanation, Explanation)
    return tuple(traces(explanation.best, before=before(explanation.best, explanation)))


def before(fit: Fit | None, explanation: Explanation | None) -> Fit | None:
    """The fit without the missing effects of an explanation; None where there are none."""
    if fit is None or explanation is None or explanation.base.model.effects == fit.model.effects:
        return None
    return explanation.base


def amplitudes(trace: Trace, comparison: Comparison | None = None) -> Amplitudes | None:
    """The amplitude densities of a trace by Welch's method (half overlapping Hann windows); None for too few samples.

    The samples are interpolated onto their median spacing.  The noise is that of the comparison, or else white.
    """
    from scipy.signal import welch

    if trace.time.size < LEAST_SAMPLES:
        return None
    spacing = float(np.median(np.diff(trace.time)))
    even = np.arange(trace.time[0], trace.time[-1] + spacing / 2, spacing)
    length = max(min(even.size, 2 * even.size // (SEGMENTS + 1)), LEAST_SAMPLES)
    signals = [np.interp(even, trace.time, v) for v in (trace.measured, trace.modelled, trace.residual)]
    frequency, density = welch(np.array(signals), fs=1 / spacing, nperseg=length, detrend="constant")
    frequency, (measured, modelled, residual) = frequency[1:], np.sqrt(density[:, 1:])
    noise = np.full(frequency.size, trace.noise * math.sqrt(2 * spacing))
    if comparison:
        known = comparison.columns[trace.column].spectra
        noise = np.sqrt(np.interp(frequency, known.frequency_hz, known.noise))
    return Amplitudes(trace, frequency, measured, modelled, residual, noise)


def _run(fit: Fit) -> list[Prediction]:
    """The predictions of a fit: of the motion from the fitted initial states, or of the torque."""
    if not fit.starts:
        return needed_torques(fit.model, fit.experiments, Channel(fit.band_hz))[0]
    pairs = zip(fit.experiments, fit.starts, strict=True)
    return [predict(fit.model, experiment, start, substep_s=fit.substep_s) for experiment, start in pairs]


def _same(some: tuple[Experiment, ...], others: tuple[Experiment, ...]) -> bool:
    """Whether both are the same segments of the same recordings."""
    return [(one.name, one.time.size, one.time[0]) for one in some] == [
        (one.name, one.time.size, one.time[0]) for one in others
    ]
