"""The fits of a model as it is to a motion that is simulated, from several initial values."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from functools import reduce

import numpy as np

from lostmotion.lab.data.frequency_response import strongest_mode
from lostmotion.lab.inverse.candidates import equation_error_fit, tried, with_values
from lostmotion.lab.inverse.output_error import OutputError
from lostmotion.lab.inverse.regression import Regression
from lostmotion.lab.inverse.signals import Signals
from lostmotion.lab.inverse.torques import follows_motion, simulable
from lostmotion.lab.selection.nesting import without
from lostmotion.lab.shooting.initial_guess import natural_frequency
from lostmotion.model import Model, ModelError
from lostmotion.model.effects import get_effect

__all__ = ["first_fits", "fits_from"]


def first_fits(model: Model, signals: Sequence[Signals]) -> list[Regression]:
    """The fits from the model as it is and from its fit to the acceleration; where the motion cannot be simulated with
    these, from the fits of the model without its effects, with effects of size zero.  The cubic spring of a stiff bar
    throws a disk on a spring of 15 N/m beyond all numbers."""
    found = fits_from(_starts(model, signals), signals)
    if found or not model.effects:
        return found
    bare = reduce(without, model.effects, model)
    return fits_from([_vanishing(model, fit.model) for fit in fits_from(_starts(bare, signals), signals)], signals)


def _starts(model: Model, signals: Sequence[Signals]) -> list[Model]:
    """The model as it is, with the values of its fit to the acceleration, without the effects that do not follow from
    the measured motion, such as a second mode, and with those of the strongest mode; if there are others, not those
    with a mode above half of the sampling rate, which has an alias below it.  To a beam that rings at 7.8 Hz, sampled
    at 79, the default mode at 71 Hz was fitted, and one at 7.9 Hz named as a second."""
    model = simulable(model, signals)
    hidden = [name for name in model.effects if not follows_motion(get_effect(name))]
    found = equation_error_fit(reduce(without, hidden, model), signals)
    strongest = strongest_mode(model, [one.experiment for one in signals])
    starts = [model, *([with_values(model, found.model)] if found else []), *([strongest] if strongest else [])]
    highest = min(one.experiment.rate_hz for one in signals) / 2
    return [one for one in starts if natural_frequency(one) < highest] or starts


def _vanishing(model: Model, bare: Model) -> Model:
    """The model with the values of one without effects, and with sizes of zero of its own."""
    names = [name for effect in model.effects for name in get_effect(effect).amplitude_names]
    zero = {name: 0.0 for name in names if not (p := model.parameters[name]).fixed and p.low <= 0.0}
    return with_values(model, bare).replace(zero)


def fits_from(models: Sequence[Model], signals: Sequence[Signals], substep_s: float = 0.0) -> list[Regression]:
    """The fits from those models with which the motion can be simulated, in the measured initial states; substep_s: the
    integration step [s], by default the one that each model needs."""
    begun = []
    for model in models:
        with suppress(ModelError):
            begun.append((model, OutputError.of(signals, model, substep_s)))
    return [
        fit
        for start, data in _promising(begun)
        if (fit := tried(start, data.horizons, data.begun(start, data.measured)))
    ]


def _promising(begun: list[tuple[Model, OutputError]]) -> list[tuple[Model, OutputError]]:
    """The initial models whose error is smaller than that of a model at rest, or all where there are none.  Others only
    take time: a bar that is far too stiff is simulated in far too many steps."""
    near = [
        (start, data) for start, data in begun
        if np.mean(data.residual(start, data.nuisance) ** 2) < data.error_at_rest**2
    ]  # fmt: skip
    return near or begun
