"""The limit of the accelerometer's range, from saturated readings.  No fitting here."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from lostmotion.lab import policy
from lostmotion.lab.data.experiment import ACCEL, Experiment
from lostmotion.model import Model
from lostmotion.model.motion import FloatArray

__all__ = ["RANGE", "at_its_rail", "rail_of", "with_range"]

RANGE = "sensor_saturation"
_END = f"{RANGE}.a_max"


def rail_of(experiments: Sequence[Experiment]) -> float | None:
    """The limit of the accelerometer's range [m/s²], where readings saturate; None where none do."""
    ends = [size.max() for size in _sizes(experiments) if np.sum(size >= size.max() * (1 - 1e-9)) >= policy.RAILED]
    return float(max(ends)) if ends else None


def at_its_rail(model: Model, experiments: Sequence[Experiment]) -> Model | None:
    """The model with the limited range of a sensor that saturates; None where it does not."""
    rail = rail_of(experiments)
    return None if rail is None else model.with_effect(RANGE).replace({_END: rail})


def with_range(model: Model, experiments: Sequence[Experiment]) -> Model:
    """The model with a sensor range at least as large as its readings: noise is added before saturation, so a fit to
    saturated readings would underestimate the range."""
    if _END not in model.parameters or model.parameters[_END].fixed:
        return model
    largest = float(max((size.max() for size in _sizes(experiments)), default=0.0))
    parameter = model.parameters[_END]
    return model.replace(
        {_END: replace(parameter, value=max(parameter.value, largest), low=max(parameter.low, largest))}
    )


def _sizes(experiments: Sequence[Experiment]) -> list[FloatArray]:
    """Magnitudes of the readings [m/s²] of each experiment that has any."""
    read = [e.measured[ACCEL] for e in experiments if ACCEL in e.measured]
    return [np.abs(values[~np.isnan(values)]) for values in read if not np.isnan(values).all()]
