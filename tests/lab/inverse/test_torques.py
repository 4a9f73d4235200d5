"""The acceleration that a model gives a measured motion."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from lostmotion.lab.data.experiment import Experiment
from lostmotion.lab.inverse.signals import Signals
from lostmotion.lab.inverse.torques import acceleration
from lostmotion.lab.models.own import effect
from lostmotion.model import Parameter, build_model
from lostmotion.model.effects.registry import unregister

TIME = np.arange(0.0, 4.0, 0.01)


def test_a_value_that_is_not_finite_concerns_its_own_sample_only() -> None:
    """An effect that has no value for negative speeds: all samples with positive ones have a finite acceleration."""

    def root(omega: float, c: float) -> float:
        return -c * math.sqrt(omega) if omega >= 0 else math.nan

    with pytest.warns(UserWarning, match="expected a finite number"):
        effect("joint", parameters={"c": Parameter(0.5, "N m", 0.0, 50.0)})(root)

    try:
        signals = Signals.of(Experiment("swing", None, TIME, {"position": np.sin(2 * np.pi * TIME)}))
        signals = replace(signals, velocity=np.cos(2 * np.pi * TIME + 0.001))
        found = acceleration(build_model("joint", ["root"]), signals, np.zeros(TIME.size))
    finally:
        unregister("root")
    assert np.array_equal(np.isfinite(found), signals.velocity > 0)
