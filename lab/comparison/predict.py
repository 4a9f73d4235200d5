"""A model's prediction of an experiment, from a start state to the last sample.  Nothing is estimated here."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from lostmotion.lab.data.experiment import Experiment
from lostmotion.model import Model, Trajectory
from lostmotion.model.motion import FloatArray

__all__ = ["Prediction", "predict"]


@dataclass(frozen=True, eq=False)
class Prediction:
    """An experiment and the model's trajectory at ``experiment.time``."""

    experiment: Experiment
    trajectory: Trajectory

    def residual(self, column: str) -> FloatArray:
        """Measured minus modelled (N,), NaN where the column was not sampled."""
        return np.asarray(self.experiment.measured[column] - self.trajectory[column])


def predict(
    model: Model, experiment: Experiment, start: ArrayLike | None = None, *, substep_s: float | None = None
) -> Prediction:
    """The model's motion from the state ``start`` (n,), or from rest relative to the input.  Raises ModelError."""
    trajectory = experiment.model(model).simulate(experiment.drive, experiment.time, start, substep_s=substep_s)
    return Prediction(experiment, trajectory)
