"""The fit of a free motion: on a growing horizon, with an integration step that resolves it.  No selection here."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace

from lostmotion.lab.deadline import is_over
from lostmotion.lab.inverse.candidates import refined
from lostmotion.lab.inverse.output_error import OutputError
from lostmotion.lab.inverse.regression import Regression, regressed
from lostmotion.lab.shooting.parameters import free_names
from lostmotion.model import Model, ModelError

__all__ = ["HORIZONS", "beginning", "continued", "resolved"]

HORIZONS = (0.2, 0.5)
"""Shares of a free swing that are fitted before the whole: a frequency error of 2 % is out of phase after ten swings,
and a fit to the whole would end in a local minimum."""
VANISHED = 1e-3
"""Share of a parameter's first value, below which it is zero."""


def continued(model: Model, swings: OutputError, begun: Regression | None = None) -> Regression:
    """The fit of a free motion on a growing horizon (homotopy); where that ends with a larger error than no motion, as
    for a pendulum that goes over the top, the fit of the whole motion at once if it is better.  begun: the fit of the
    first horizon, if there is one."""
    start, shortest, *longer = model, *HORIZONS
    model = _not_vanished((begun or regressed(model, swings.first(shortest))).model, start)
    for share in longer:
        model = _not_vanished(regressed(model, swings.first(share)).model, start)
    found = regressed(model, swings)
    if found.rms <= swings.usual(model):
        return found
    return min(found, regressed(start, swings), key=lambda one: one.rms)


def beginning(fit: Regression) -> Regression | None:
    """The fit of a model that was fitted to the acceleration to the beginning of a free motion, if it can be."""
    with suppress(ModelError):
        return regressed(fit.model, OutputError.of(fit.data.signals, fit.model).first(HORIZONS[0]))
    return None


def resolved(fit: Regression) -> Regression:
    """The fit with an integration step that is short for its residual, if the time allows."""
    if not isinstance(fit.data, OutputError) or is_over():
        return fit
    data = fit.data.resolved(fit.model, fit.nuisance)
    return fit if data is fit.data else refined(replace(fit, data=data))


def _not_vanished(model: Model, start: Model) -> Model:
    """The model with the first values of those parameters that a short horizon took to zero, where a fit would stay: a
    mass that is damped within four swings had no damping."""
    first = {name: start.parameters[name].value for name in free_names(start)}
    return model.replace(
        {name: v for name, v in first.items() if v > 0 and model.parameters[name].value < VANISHED * v}
    )
