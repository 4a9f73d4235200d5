"""Whether the parameters of a model are the same in all recordings: a test of parameter constancy.

Recordings of one question are taken for those of one machine.  Where they are of several, such as a mass on different
springs or a drive under different controllers, one model fits none of them, and no effect explains why.  The model is
fitted to each recording alone (Chow, Econometrica 28, 1960, 591-605), and the evidence is that for an effect: these
fits, cross-validated, predict better (selection/evidence.py).
"""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from lostmotion.lab import policy
from lostmotion.lab.data.series import is_onward, rms
from lostmotion.lab.deadline import is_over
from lostmotion.lab.inverse.candidates import tried
from lostmotion.lab.inverse.first_fits import fits_from
from lostmotion.lab.inverse.output_error import OutputError
from lostmotion.lab.inverse.problem import InverseModel
from lostmotion.lab.inverse.regression import Regression
from lostmotion.lab.inverse.signals import Signals
from lostmotion.lab.parallel import each
from lostmotion.lab.quantity import of_axis, quantities, with_unit
from lostmotion.lab.selection.evidence import Predictions
from lostmotion.lab.words import column
from lostmotion.model import Model

__all__ = ["Differing", "differing", "warn_of_differing"]

log = logging.getLogger(__name__)


class Differing(NamedTuple):
    """The parameter whose difference from the median of all recordings changes the recording ``odd`` most, to first
    order; this one gains most by a fit of its own.

    least, most: the smallest and the largest estimate of the parameter, each with the name of the recording; together,
    own: root mean square of what ``odd`` leaves with one fit for all, and with its own, in the unit of the problem.
    """

    name: str
    least: tuple[float, str]
    most: tuple[float, str]
    odd: str
    together: float
    own: float


def warn_of_differing(fit: Regression, signals: Sequence[Signals], floor: float, pool: Executor | None) -> None:
    """Warns of a parameter that is not the same in these recordings; see ``differing``."""
    found = differing(fit, signals, floor, pool)
    if not found:
        return
    axis = fit.data.axis
    (together, own), unit = quantities(column(fit.data.column, *axis)[1], found.together, found.own)
    ends = (found.least[0], found.most[0])
    apart = (ends[1] - ends[0]) / max(*map(abs, ends), 1e-300)
    digits = 2 + max(math.floor(-math.log10(max(apart, 1e-9))), 0)
    (least, most), own_unit = quantities(of_axis(fit.model.parameters[found.name].unit, *axis), *ends, digits=digits)
    log.warning(
        "%s: one fit for all recordings leaves %s, a fit of its own %s: %s is %s in %s and %s in %s; were they "
        "recorded on different machines, or with other zeros? Else an effect is missing. Ask about each alone",
        found.odd, with_unit(together, unit), own,
        found.name, with_unit(least, own_unit), found.least[1], most, found.most[1],
    )  # fmt: skip


def differing(fit: Regression, signals: Sequence[Signals], floor: float, pool: Executor | None) -> Differing | None:
    """A parameter that differs between these recordings, where one of them is predicted significantly better by a fit
    of its own, and one fit for all is behind that (``policy.BEHIND``).  None where that is not so, where the recordings
    are parts of one, or where the time is up.

    fit: of the model, which these fits begin at; floor: root mean square of the noise.
    """
    names = [one.experiment.name for one in signals]
    if len(signals) < 2 or len({*names}) < len(signals) or not fit.unknowns.items:
        return None
    fits = [one for _, one in each(pool, lambda one: _fitted(fit, _alone(fit.model, one), [one]), signals) if one]
    whole = _fitted(fit, fit.model, signals)
    if is_over() or whole is None or len(fits) < len(signals):
        return None
    left = whole.data.by_recording(whole.misfit)
    odd = max(range(len(fits)), key=lambda at: rms(left[at]) / max(rms(fits[at].predicted), floor))
    own, together = fits[odd], left[odd]
    evidence = Predictions(together**2, own.predicted**2, own.block)
    is_behind = rms(together) > policy.BEHIND * rms(own.predicted)
    if not (is_behind and evidence.is_better(len(fits))):
        return None
    away = own.z - np.median([own.unknowns.z(one.model) for one in fits], axis=0)
    changed = np.abs(away) * np.linalg.norm(own.jacobian[:, : own.count], axis=0)
    name = own.unknowns.names[int(np.argmax(changed))]
    values = sorted(zip((one.model.parameters[name].value for one in fits), names, strict=True))
    return Differing(name, values[0], values[-1], names[odd], rms(together), own.error)


def _alone(model: Model, one: Signals) -> Model:
    """The model for a recording alone: its constant torque is that of all, if it moves in one direction, in which
    friction acts as a constant."""
    if "bias" not in model.parameters or not is_onward(one.experiment.measured[one.column]):
        return model
    return model.replace({"bias": replace(model.parameters["bias"], fixed=True)})


def _fitted(fit: Regression, model: Model, signals: Sequence[Signals]) -> Regression | None:
    """The model fitted to these recordings, from its values, as ``fit`` was; None where that fails."""
    if is_over():
        return None
    if isinstance(fit.data, OutputError):
        return next(iter(fits_from([model], signals, fit.data.substep_s)), None)
    torque = InverseModel.of(signals, model)
    return tried(model, [torque], torque.nuisance)
