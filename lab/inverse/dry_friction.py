"""How steeply dry friction changes sign in a model: as the recordings tell, not as a convention in rad/s.  Nothing is
fitted here."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lostmotion.lab import policy
from lostmotion.lab.inverse.signals import Signals
from lostmotion.model import Model, build_model

__all__ = ["simulable", "softened"]


def softened(model: Model, signals: Sequence[Signals]) -> Model:
    """The model with dry friction that changes sign as steeply as the filtered speed tells, or less where the model
    says so: a width in rad/s is wide for a slow joint, and for an axis in m/s, and depends on the unit of time."""
    width = policy.UNSURE_SPEED * float(np.sqrt(np.mean(np.concatenate([one.velocity for one in signals]) ** 2)))
    usual = build_model(model.base, model.effects).parameters
    widths = {
        name: width
        for name, parameter in model.parameters.items()
        if name.endswith(".omega_0") and parameter.fixed and (parameter.value < width or parameter == usual[name])
    }
    return model.replace(widths)


def simulable(model: Model, signals: Sequence[Signals]) -> Model:
    """The same for a model that is simulated; a servo's as it is.  It holds its load at rest for much of a recording,
    and creeps in a wider step: of one that sticks Stribeck friction was named, and nothing of an XL330."""
    return model if model.base == "servo" else softened(model, signals)
