"""The limit of the accelerometer's range, from saturated readings.

It is read off the readings and not fitted: the search of gears uses it as a candidate, and fits as a bound.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from lostmotion.lab.data.experiment import ACCEL, Experiment
from lostmotion.lab.data.readings import cut_ends
from lostmotion.model import Model
from lostmotion.model.motion import FloatArray

__all__ = ["RANGE", "clipping_level", "with_clipping", "with_range"]

RANGE = "sensor_saturation"
_END = f"{RANGE}.a_max"


def clipping_level(experiments: Sequence[Experiment]) -> float | None:
    """The limit of the accelerometer's range [m/s²]: the largest magnitude of the readings of an experiment, if they
    are cut off there (see ``cut_ends``), at one end or at both together; else None."""
    limits = []
    for values in _readings(experiments):
        largest = float(np.abs(values).max())
        limits += [largest for end, _ in (*cut_ends(values), *cut_ends(np.abs(values))) if abs(end) == largest]
    return max(limits, default=None)


def with_clipping(model: Model, experiments: Sequence[Experiment]) -> Model | None:
    """The model with a limited range of the sensor at the limit that the readings show; None where they show none."""
    rail = clipping_level(experiments)
    return None if rail is None else model.with_effect(RANGE).replace({_END: rail})


def with_range(model: Model, experiments: Sequence[Experiment]) -> Model:
    """The model with a range of the sensor, if it has a limited one, of at least the largest reading.  As noise is
    added before saturation, a fit to saturated readings would underestimate the range."""
    if _END not in model.parameters or model.parameters[_END].fixed:
        return model
    largest = max((float(np.abs(values).max()) for values in _readings(experiments)), default=0.0)
    parameter = model.parameters[_END]
    return model.replace(
        {_END: replace(parameter, value=max(parameter.value, largest), low=max(parameter.low, largest))}
    )


def _readings(experiments: Sequence[Experiment]) -> list[FloatArray]:
    """The readings of the accelerometer (N_i,) [m/s²] of each experiment that has any."""
    read = [e.measured[ACCEL] for e in experiments if ACCEL in e.measured]
    return [values[~np.isnan(values)] for values in read if not np.isnan(values).all()]
