"""The fit of a simulated free motion: on a growing horizon, with an integration step that is short enough.

The likelihood of motions that no input drives uses it (likelihood.py).  No selection here.
"""

from __future__ import annotations

from dataclasses import replace

from lostmotion.lab.deadline import is_over
from lostmotion.lab.inverse.candidates import HORIZONS, not_vanished, refined
from lostmotion.lab.inverse.output_error import OutputError
from lostmotion.lab.inverse.regression import Regression, regressed
from lostmotion.model import Model

__all__ = ["continued", "resolved"]


def continued(model: Model, swings: OutputError) -> Regression:
    """Fits a free motion on a growing horizon (a homotopy): the shares ``HORIZONS`` of it, then the whole.

    Where this fit ends with a larger error than a model at rest, as that of a pendulum that goes over the top may, the
    whole motion is also fitted at once, and the better fit is returned.
    """
    start = model
    for share in HORIZONS:
        model = not_vanished(regressed(model, swings.first(share)).model, start)
    found = regressed(model, swings)
    if found.rms <= swings.signal_rms(model):
        return found
    return min(found, regressed(start, swings), key=lambda one: one.rms)


def resolved(fit: Regression) -> Regression:
    """The fit with an integration step whose error is small against the residual, if the time allows; see
    ``OutputError.resolved``."""
    if not isinstance(fit.data, OutputError) or is_over():
        return fit
    data = fit.data.resolved(fit.model, fit.nuisance)
    return fit if data is fit.data else refined(replace(fit, data=data))
