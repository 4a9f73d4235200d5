"""Compares a model with measurements: the size of the error, where it occurs, and in which equation it arises.

The model is simulated from an initial state to the end of each recording.  For a joint with a measured torque, whose
simulation would diverge, the torque is compared with the one that the model needs for the measured motion (torque.py).
The residual is compared with the noise, in time, over phases of the motion, in frequency and over every state
(residual_maps.py).  The unknown function that explains most of it (discrepancy/describe.py) shows the equation in which
it arises.  No parameter is fitted.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from lostmotion.drivers.recording import Recording
from lostmotion.lab import policy, words
from lostmotion.lab.comparison.residual_analysis import (
    ColumnResidual,
    PhaseError,
    Prediction,
    predict,
)
from lostmotion.lab.comparison.torque import TORQUE, needed_torques
from lostmotion.lab.data.autoregression import NoiseModel, fit_autoregression
from lostmotion.lab.data.excerpt import excerpts
from lostmotion.lab.data.experiment import ACCEL, Experiment
from lostmotion.lab.data.noise import noise_models
from lostmotion.lab.data.series import rms
from lostmotion.lab.data.whiteness import fit_percent
from lostmotion.lab.discrepancy.describe import described
from lostmotion.lab.discrepancy.residual_maps import ResidualMap
from lostmotion.lab.fitting.strategy import unfitted
from lostmotion.lab.inverse.channel import Channel
from lostmotion.lab.inverse.fitted import followed, is_noise
from lostmotion.lab.inverse.likelihood import Method
from lostmotion.lab.inverse.modes import band_limited
from lostmotion.lab.inverse.output_error import OutputError, initial_state
from lostmotion.lab.inverse.release import released
from lostmotion.lab.inverse.signals import Signals
from lostmotion.lab.results import Displayed, Finding
from lostmotion.lab.shooting.initial_state import FINE, find_start, segment_of
from lostmotion.lab.shooting.parameters import free_names, held
from lostmotion.lab.shooting.task import Task, fine_substep
from lostmotion.model import Model, predictability_horizon
from lostmotion.model.motion import FloatArray

__all__ = ["Comparison", "Overlay", "compare"]

DESCRIBED_S = 2.0
"""Length of the motion from which the residual is described [s]."""
MENTIONED = 0.05
"""Share of the error below which a phase or a map is not reported."""


@dataclass(frozen=True, eq=False)
class Overlay:
    """One column of one recording.

    time [s], measured, modelled: (N,) each, NaN where the column was not sampled; noise: its root mean square, in the
    unit of the column; horizon_s: for how long the motion can be predicted, infinite where to the end.
    """

    recording: str
    column: str
    unit: str
    time: FloatArray
    measured: FloatArray
    modelled: FloatArray
    noise: float
    horizon_s: float

    @property
    def what(self) -> str:
        """The quantity in the column: "acceleration"."""
        return words.column(self.column, self.unit != words.column(self.column)[1])[0]

    @property
    def residual(self) -> FloatArray:
        """Measured minus modelled (N,)."""
        return self.measured - self.modelled

    @property
    def rms(self) -> float:
        """Root mean square of the residual."""
        return rms(self.residual)

    @property
    def fit_percent(self) -> float:
        """The fit 100 (1 - |residual|/|measured - its mean|) [%]."""
        return fit_percent(self.measured, self.modelled)


@dataclass(frozen=True, eq=False, repr=False)
class Comparison(Displayed):
    """The result of a comparison.

    columns: the residual of each compared column; starts: the initial state (n,) of each experiment that was simulated;
    localisation: the equation in which the residual of the first column arises, None where the residual is noise or no
    equation explains it.
    """

    model: Model
    experiments: tuple[Experiment, ...]
    starts: tuple[FloatArray, ...]
    overlays: tuple[Overlay, ...]
    columns: Mapping[str, ColumnResidual]
    localisation: Finding | None = None
    delay_s: float = 0.0
    """How much later than recorded the torque of a joint acts [s]; this delay was removed."""

    @property
    def column(self) -> str:
        """The main column: the first that its base is compared with."""
        return next(iter(self.experiments[0].measured))

    def label(self, column: str) -> tuple[str, str]:
        """The name of the quantity in the column, and its SI unit."""
        return words.column(column, self.experiments[0].is_linear, self.experiments[0].drive_unit)

    def of(self, column: str) -> tuple[Overlay, ...]:
        """The overlays of that column in all recordings."""
        return tuple(one for one in self.overlays if one.column == column)

    def rms(self, column: str) -> float:
        """Root mean square of all residuals of that column."""
        return rms(*(one.residual for one in self.of(column)))

    def fit_percent(self, column: str) -> float:
        """Fit of that column over all recordings [%]."""
        pairs = [(one.measured - np.nanmean(one.measured), one.residual) for one in self.of(column)]
        spread, error = (rms(*part) for part in zip(*pairs, strict=True))
        return 100 * (1 - error / max(spread, 1e-300))

    def worst_phase(self, column: str) -> PhaseError:
        """The phase of the motion in which the error is largest, of those that hold a twentieth of it or more."""
        return max((one for one in self.columns[column].phases if one.error > MENTIONED), key=lambda one: one.rms)

    @property
    def is_noise(self) -> bool:
        """Whether the residual of the main column is noise: no larger, and without a significant map."""
        return self.is_small(self.column) and not any(one.significant for one in self.columns[self.column].maps)

    def is_small(self, column: str) -> bool:
        """Whether the residual of that column is no larger than its noise."""
        noise = self.columns[column].noise.rms
        if column == TORQUE:  # its floor is an extrapolation
            return is_noise(np.concatenate([one.residual[~np.isnan(one.residual)] for one in self.of(column)]), noise)
        return self.rms(column) <= policy.GOOD * noise

    def document(self) -> dict[str, Any]:
        """The keys of ``lab compare --json``."""
        column = self.column
        error = {"before": self.rms(column), "after": self.rms(column), "noise": self.columns[column].noise.rms,
                 "unit": self.label(column)[1]}  # fmt: skip
        return {
            "base": self.model.base,
            "effects": list(self.model.effects),
            "error": error,
            "complete": self.is_noise,
            "is_noise": self.is_noise,
            "delay_s": self.delay_s,
            "columns": {name: self._column(name) for name in self.columns},
            "residual": self.localisation.document() if self.localisation else None,
            "recordings": [_row(one) for one in self.overlays],
        }

    def _column(self, name: str) -> dict[str, Any]:
        own = self.columns[name]
        return {
            "unit": self.label(name)[1],
            "rms": self.rms(name),
            "noise": own.noise.rms,
            "fit_percent": self.fit_percent(name),
            "tests": {test: {"p_value": one.p_value, "significant": one.significant}
                      for test, one in own.tests.items()},
            "phases": [vars(one) for one in own.phases],
            "blocks": [vars(one) for one in own.blocks],
            "bands": [vars(one) for one in own.spectra.bands],
            "maps": [_map(one) for one in own.maps],
        }  # fmt: skip


def compare(
    model: Model,
    experiments: Sequence[Experiment],
    starts: Sequence[FloatArray] | None = None,
    *,
    recordings: Sequence[Recording] = (),
    is_described: bool = True,
) -> Comparison:
    """Compares the model with the experiments.

    starts: the state (n,) at the first sample of each experiment, by default estimated, and with it the zero of the
    place of what is not commanded; recordings: those of the experiments, for their temperature; is_described: whether
    to search for the equation in which the residual arises.  Raises ModelError where the model cannot be simulated.
    """
    method = Method.of(model, experiments) if starts is None else Method.SEGMENTS
    if method is not Method.SEGMENTS:
        experiments = released(band_limited(model, experiments))
    if method is Method.TORQUE:
        channel = Channel.of(experiments)
        channel.warn(experiments[0].name)
        predictions, floor_nm, left = needed_torques(model, experiments, channel)
        endless = [math.inf] * len(predictions)
        found = _compared(model, predictions, endless, {TORQUE: NoiseModel.white(floor_nm)}, recordings)
        return replace(found, delay_s=channel.delay_s, localisation=None if found.is_noise else left)
    also: list[list[FloatArray]] = [[] for _ in experiments]
    if method is Method.MOTION and model.base != "servo":
        experiments, also = map(list, zip(*(_followed(model, one) for one in experiments), strict=True))
    floor = noise_models(experiments)
    if starts is None:
        starts = [_start(model, one, floor, guesses) for one, guesses in zip(experiments, also, strict=True)]
    predictions = [predict(model, one, start) for one, start in zip(experiments, starts, strict=True)]
    horizons = [_horizon(model, one, start) for one, start in zip(predictions, starts, strict=True)]
    found = replace(_compared(model, predictions, horizons, floor, recordings), starts=tuple(starts))
    if found.is_noise or not is_described:
        return found
    return replace(found, localisation=_described(model, experiments, {name: one.rms for name, one in floor.items()}))


def _described(model: Model, experiments: Sequence[Experiment], noise: dict[str, float]) -> Finding | None:
    """The description of the residual with the parameters held, over the seconds in which the motion changes most."""
    fixed = held(model, free_names(model))
    task = Task.of(fixed, excerpts(experiments, DESCRIBED_S), noise)
    return described(unfitted(fixed, task.tiles, task), task)


def _compared(
    model: Model, predictions: Sequence[Prediction], horizons: Sequence[float], floor: Mapping[str, NoiseModel],
    recordings: Sequence[Recording],
) -> Comparison:  # fmt: skip
    """The comparison of these predictions, without a localisation; floor: the noise of each column."""
    experiments = [one.experiment for one in predictions]
    columns = {name: _residual(name, model.base, predictions, recordings, noise) for name, noise in floor.items()}
    return Comparison(model, tuple(experiments), (), tuple(_overlays(predictions, horizons, columns)), columns)


def _residual(
    name: str, base: str, predictions: Sequence[Prediction], recordings: Sequence[Recording], floor: NoiseModel
) -> ColumnResidual:
    """The residual of one column.  Its noise is the floor, or the noise model of the residual where that is smaller."""
    own = [one.at_rows_of(name) for one in predictions if name in one.experiment.measured]
    left = fit_autoregression([one.residual(name) for one in own])
    temperatures = [_temperature(one.experiment, recordings) for one in own]
    return ColumnResidual(base, name, own, temperatures, left if left.rms < floor.rms else floor)


def _overlays(
    predictions: Sequence[Prediction], horizons: Sequence[float], columns: Mapping[str, ColumnResidual]
) -> Iterator[Overlay]:
    for prediction, horizon in zip(predictions, horizons, strict=True):
        experiment = prediction.experiment
        for name, measured in experiment.measured.items():
            unit = words.column(name, experiment.is_linear, experiment.drive_unit)[1]
            yield Overlay(experiment.name, name, unit, experiment.time, measured, prediction.trajectory[name],
                          columns[name].noise.rms, horizon)  # fmt: skip


def _followed(model: Model, experiment: Experiment) -> tuple[Experiment, list[FloatArray]]:
    """The experiment with its place counted from the zero of the model, as a fit does, which has one of its own for
    each recording but the first, and an initial state (n,) from which the model follows it, if there is one.

    The place stays as it is where another zero lowers no error: of a model in which nothing depends on the place, any
    zero and the initial position cancel.
    """
    fixed, signals = held(model, free_names(model)), Signals.of(experiment)
    data = OutputError.of([signals], fixed)
    fit, zero = followed(fixed, data), 0.0
    if ACCEL not in experiment.measured:
        own = replace(data, is_anchored=False)
        other = followed(fixed, own)
        if other and not (fit and fit.rms <= other.rms + data.accuracy):
            fit, (zero,) = other, own.zeros(fixed, other.nuisance)
    if fit is None:
        return experiment, []
    moved = signals.shifted(-zero).experiment if zero else experiment
    return moved, [initial_state(moved.model(fixed), moved, data.starts(fit.nuisance)[0], data.free)]


def _start(
    model: Model, experiment: Experiment, floor: Mapping[str, NoiseModel], also: Sequence[FloatArray]
) -> FloatArray:
    """The initial state that minimises the error, of gears on longer and longer segments; also: first guesses (n,)."""
    whole = segment_of(model, experiment, {name: one.rms for name, one in floor.items()})
    return find_start(model, whole, fine_substep(model, [experiment]), also, FINE).start


def _horizon(model: Model, prediction: Prediction, start: FloatArray) -> float:
    experiment = prediction.experiment
    step = prediction.trajectory.substep_s
    return predictability_horizon(
        experiment.model(model), experiment.drive, experiment.time, start, substep_s=step
    )  # fmt: skip


def _temperature(experiment: Experiment, recordings: Sequence[Recording]) -> FloatArray | None:
    for one in recordings:
        if one.name == experiment.name and np.isfinite(one.columns.get("temperature", np.nan)).any():
            time, values = one.signal("temperature")
            return np.interp(experiment.time, time, values)
    return None


def _map(one: ResidualMap) -> dict[str, Any]:
    arrays = {"x": one.x.tolist(), "mean": one.mean.tolist(), "half_width": one.half_width.tolist()}
    return {"variable": one.variable, "unit": words.variable(one.variable)[1], "explained": one.explained,
            "p_value": one.p_value, "significant": one.significant, **arrays}  # fmt: skip


def _row(one: Overlay) -> dict[str, Any]:
    horizon = one.horizon_s if math.isfinite(one.horizon_s) else None
    return {"recording": one.recording, "column": one.column, "fit_percent": one.fit_percent, "rms": one.rms,
            "noise": one.noise, "unit": one.unit, "horizon_s": horizon}  # fmt: skip
