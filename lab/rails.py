"""Readings at the end of the sensor's range: seen in the recordings themselves, before any model.  No fitting here."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lostmotion.lab.experiment import Experiment
from lostmotion.model import Model

__all__ = ["RANGE", "at_its_rail", "rail_of"]

COLUMN, RANGE = "accel", "sensor_saturation"
RAILED = 6
"""So many readings of the very same largest size, in one recording: noise does not repeat itself like that."""


def rail_of(experiments: Sequence[Experiment]) -> float | None:
    """The end of the accelerometer's range [m/s²], where readings stop at it; None where none do."""
    ends = []
    for experiment in experiments:
        size = np.abs(experiment.measured.get(COLUMN, np.empty(0)))
        size = size[~np.isnan(size)]
        if size.size and int(np.sum(size >= size.max() * (1 - 1e-9))) >= RAILED:
            ends.append(float(size.max()))
    return max(ends, default=None)


def at_its_rail(model: Model, experiments: Sequence[Experiment]) -> Model | None:
    """The model with a sensor whose range ends where the readings stop; None where they do not."""
    rail = rail_of(experiments)
    if rail is None:
        return None
    return model.with_effect(RANGE).replace({f"{RANGE}.a_max": rail})
