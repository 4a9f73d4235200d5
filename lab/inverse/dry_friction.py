"""The width in which dry friction changes sign in a model: it follows from the recordings, not from a convention in
rad/s.  Nothing is fitted here."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lostmotion.lab import policy
from lostmotion.lab.inverse.signals import Signals
from lostmotion.model import Model, build_model

__all__ = ["simulable", "softened"]


def softened(model: Model, signals: Sequence[Signals]) -> Model:
    """The model with dry friction that changes sign within the resolution of the filtered speed, or a larger width of
    the model: a fixed width in rad/s is wide for a slow joint, and for an axis in m/s, and depends on the unit of
    time."""
    width = policy.UNSURE_SPEED * float(np.sqrt(np.mean(np.concatenate([one.velocity for one in signals]) ** 2)))
    usual = build_model(model.base, model.effects).parameters
    widths = {
        name: width
        for name, parameter in model.parameters.items()
        if name.endswith(".omega_0") and parameter.fixed and (parameter.value < width or parameter == usual[name])
    }
    return model.replace(widths)


def simulable(model: Model, signals: Sequence[Signals]) -> Model:
    """The same for a model that is simulated; servos are unchanged.  A servo holds its load at rest for much of a
    recording, and would creep within a wider step: Stribeck friction was named for one that sticks, and nothing for an
    XL330."""
    return model if model.base == "servo" else softened(model, signals)
