"""How steeply dry friction changes sign in a model: as the recordings tell, not as a convention in rad/s.  Nothing is
fitted here."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lostmotion.lab import policy
from lostmotion.lab.inverse.signals import Signals
from lostmotion.model import Model, build_model

__all__ = ["softened"]

HOLDS = 0.25
"""Of the width of other bases, that of a servo: within it friction creeps instead of sticking, and a servo holds its
load at rest for much of a recording.  With the whole width nothing was named of an XL330 under control; with 0.1 an
STS3215 needed steps four times as short."""


def softened(model: Model, signals: Sequence[Signals]) -> Model:
    """The model with dry friction that changes sign as steeply as the filtered speed tells, or less where the model
    says so: a width in rad/s is wide for a slow joint, and for an axis in m/s, and depends on the unit of time."""
    told = policy.UNSURE_SPEED * float(np.sqrt(np.mean(np.concatenate([one.velocity for one in signals]) ** 2)))
    told *= HOLDS if model.base == "servo" else 1.0
    usual = build_model(model.base, model.effects).parameters
    widths = {
        name: told
        for name, parameter in model.parameters.items()
        if name.endswith(".omega_0") and parameter.fixed and (parameter.value < told or parameter == usual[name])
    }
    return model.replace(widths)
