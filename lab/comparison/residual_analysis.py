"""The prediction of an experiment by a model, and the analysis of its residual, column by column: in time, by phase of
the motion, in frequency, and over every state.

compare.py simulates the model and combines the columns.  No parameter is estimated here.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from lostmotion.lab.comparison.bands import Spectra, spectra
from lostmotion.lab.comparison.phases import phases
from lostmotion.lab.data.autoregression import NoiseModel
from lostmotion.lab.data.experiment import Experiment, own_rows
from lostmotion.lab.data.series import rms
from lostmotion.lab.data.whiteness import Correlation, autocorrelation, cross_correlation
from lostmotion.lab.discrepancy.residual_maps import ResidualMap, residual_maps
from lostmotion.model import Model, Trajectory
from lostmotion.model.motion import FloatArray

__all__ = ["Block", "ColumnResidual", "PhaseError", "Prediction", "predict"]

BLOCKS = 20
"""Number of parts of a recording whose errors are reported."""
MOTION = {"position": "theta_2", "velocity": "omega_2", "acceleration": "acceleration", "torque": "torque",
          "displacement": "q", "gap": "gap", "command": "command"}  # fmt: skip
"""The signals of a trajectory over which the residual is mapped, and the names of the maps; force is added by
``_variables``, as it has two meanings."""


@dataclass(frozen=True, eq=False)
class Prediction:
    """An experiment and the model's trajectory at ``experiment.time``."""

    experiment: Experiment
    trajectory: Trajectory

    def residual(self, column: str) -> FloatArray:
        """Measured minus modelled (N,), NaN where the column was not sampled."""
        return np.asarray(self.experiment.measured[column] - self.trajectory[column])

    def at_rows_of(self, column: str) -> Prediction:
        """The prediction at the rows of a column, where that was sampled more slowly than the others; else itself.

        The position of a servo at 100 Hz is in one of ten rows of an acceleration at 1 kHz.  The rows between are not
        gaps, and neighbouring samples and spectra are those at the rate of the column.
        """
        at = own_rows(self.experiment.measured[column])
        if at is None:
            return self
        experiment, there = self.experiment, self.trajectory
        measured = {name: values[at] for name, values in experiment.measured.items()}
        signals = {name: values[at] for name, values in there.signals.items()}
        return Prediction(
            replace(experiment, time=experiment.time[at], measured=measured),
            replace(there, time=there.time[at], signals=signals, states=there.states[at]),
        )


def predict(
    model: Model, experiment: Experiment, start: ArrayLike | None = None, *, substep_s: float | None = None
) -> Prediction:
    """The prediction of a model from the initial state ``start`` (n,), or from rest relative to the input.  Raises
    ModelError where the model cannot be simulated."""
    trajectory = experiment.model(model).simulate(experiment.drive, experiment.time, start, substep_s=substep_s)
    return Prediction(experiment, trajectory)


@dataclass(frozen=True)
class PhaseError:
    """Root mean square of the residual in one phase of the motion; samples, error: the shares of the samples and of the
    squared error that are in this phase."""

    phase: str
    rms: float
    samples: float
    error: float


@dataclass(frozen=True)
class Block:
    """Root mean square of the residual in a segment of time [s]."""

    recording: str
    start: float
    stop: float
    rms: float


@dataclass(frozen=True, eq=False)
class ColumnResidual:
    """The residual of one column in all recordings that have it.

    base: that of the model; predictions: of these recordings; temperatures: (N,) for each, None where not recorded;
    noise: of the sensor.
    """

    base: str
    name: str
    predictions: Sequence[Prediction]
    temperatures: Sequence[FloatArray | None]
    noise: NoiseModel

    @cached_property
    def residuals(self) -> list[FloatArray]:
        """The residual of each recording (N,), NaN where the column was not sampled."""
        return [one.residual(self.name) for one in self.predictions]

    @cached_property
    def tests(self) -> dict[str, Correlation]:
        """Correlations in the longest recording: of the residual with itself, the input and the input's rate."""
        longest = int(np.argmax([r.size for r in self.residuals]))
        residual, experiment = self.residuals[longest], self.predictions[longest].experiment
        tests = {"residual with itself": autocorrelation(residual)}
        if experiment.drive is not None:
            for name, series in (("input", experiment.drive.position), ("input's rate", experiment.drive.velocity)):
                source = np.asarray(series(experiment.time))
                if np.ptp(source) > 0:
                    tests[f"residual with the {name}"] = cross_correlation(residual, source)
        return tests

    @cached_property
    def phases(self) -> tuple[PhaseError, ...]:
        """The errors of the phases of the motion, the one with the largest share first."""
        squares: dict[str, list[FloatArray]] = {}
        for prediction, residual in zip(self.predictions, self.residuals, strict=True):
            for phase, mask in phases(self.base, prediction.trajectory).items():
                inside = residual[mask & np.isfinite(residual)] ** 2
                squares.setdefault(phase, []).append(inside)
        all_of_it = np.concatenate([part for parts in squares.values() for part in parts])
        found = [_phase(name, np.concatenate(parts), all_of_it) for name, parts in squares.items()]
        return tuple(sorted((one for one in found if one.samples > 0), key=lambda one: -one.error))

    @cached_property
    def blocks(self) -> tuple[Block, ...]:
        """The errors in ``BLOCKS`` equal parts of each recording."""
        found = []
        for prediction, residual in zip(self.predictions, self.residuals, strict=True):
            time = prediction.experiment.time
            edges = np.linspace(time[0], time[-1], BLOCKS + 1)
            for start, stop in itertools.pairwise(edges):
                inside = residual[(time >= start) & (time <= stop)]
                if np.any(np.isfinite(inside)):
                    found.append(Block(prediction.experiment.name, float(start), float(stop), rms(inside)))
        return tuple(found)

    @cached_property
    def spectra(self) -> Spectra:
        """Spectra over all recordings, compared with the noise."""
        measured = [one.experiment.measured[self.name] for one in self.predictions]
        return spectra(measured, self.residuals, self.predictions[0].experiment.rate_hz, self.noise)

    @cached_property
    def maps(self) -> tuple[ResidualMap, ...]:
        """Residual maps over every state of the motion."""
        given = [_variables(one, t) for one, t in zip(self.predictions, self.temperatures, strict=True)]
        common = [name for name in given[0] if all(name in other for other in given)]
        return residual_maps(self.residuals, {name: [one[name] for one in given] for name in common})


def _variables(prediction: Prediction, temperature: FloatArray | None) -> dict[str, FloatArray]:
    """The variables that the residual may depend on, (N,) each."""
    trajectory = prediction.trajectory
    found = {MOTION[name]: values for name, values in trajectory.signals.items() if name in MOTION}
    if "force" in trajectory.signals:
        found["load" if "gap" in trajectory.signals else "force"] = trajectory["force"]
    if "displacement" in trajectory.signals:
        found["q'"] = np.gradient(trajectory["displacement"], trajectory.time)
    if "position" not in trajectory.signals:  # the oscillator alone: no joint, no speed of one
        found.pop("omega_2", None)
    found["time"] = trajectory.time
    if temperature is not None:
        found["temperature"] = temperature
    return found


def _phase(name: str, squares: FloatArray, all_of_it: FloatArray) -> PhaseError:
    """The error of a phase from its squared residuals, and those of all phases."""
    share = float(squares.sum() / max(all_of_it.sum(), 1e-300))
    error = float(np.sqrt(squares.mean())) if squares.size else 0.0
    return PhaseError(name, error, squares.size / all_of_it.size, share)
