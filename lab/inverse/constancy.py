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
from lostmotion.lab.deadline import is_over
from lostmotion.lab.inverse.candidates import tried
from lostmotion.lab.inverse.fitted import fit_on, is_noise
from lostmotion.lab.inverse.output_error import OutputError
from lostmotion.lab.inverse.regression import Regression
from lostmotion.lab.inverse.signals import Signals
from lostmotion.lab.parallel import each
from lostmotion.lab.quantity import of_axis, quantities, with_unit
from lostmotion.lab.selection.evidence import Predictions
from lostmotion.lab.words import column

__all__ = ["Differing", "differing", "warn_of_differing"]

log = logging.getLogger(__name__)


class Differing(NamedTuple):
    """The parameter whose estimates from single recordings differ by most standard deviations.

    least, most: its smallest and its largest estimate, each with the name of the recording; together, own: root mean
    square of what all recordings leave with one fit, and with fits of their own, in the unit of the problem.
    """

    name: str
    least: tuple[float, str]
    most: tuple[float, str]
    together: float
    own: float


def warn_of_differing(fit: Regression, signals: Sequence[Signals], floor: float, pool: Executor | None) -> None:
    """Warns of a parameter that is not the same in these recordings; see ``differing``."""
    found = differing(fit, signals, floor, pool)
    if not found:
        return
    axis = fit.data.axis
    (together, own), unit = quantities(column(fit.data.column, *axis)[1], found.together, found.own)
    (least, most), own_unit = quantities(
        of_axis(fit.model.parameters[found.name].unit, *axis), found.least[0], found.most[0]
    )
    log.warning(
        "%s and %d more: one fit for all leaves %s, fits of their own %s: %s is %s in %s and %s in %s; were they "
        "recorded on different machines? Else an effect is missing. Ask about each alone",
        signals[0].experiment.name, len(signals) - 1, with_unit(together, unit), own,
        found.name, with_unit(least, own_unit), found.least[1], most, found.most[1],
    )  # fmt: skip


def differing(fit: Regression, signals: Sequence[Signals], floor: float, pool: Executor | None) -> Differing | None:
    """The parameter that differs most between these recordings, where fits of their own predict significantly better,
    and leave at most ``policy.OWN_SHARE`` of the squared error.  None where they do not, where the recordings are parts
    of one, or where the time is up.

    fit: of the model to most of them; floor: root mean square of the noise.
    """
    names = [one.experiment.name for one in signals]
    if len(signals) < 2 or len({*names}) < len(signals) or not fit.unknowns.items:
        return None
    pairs = [pair for _, pair in each(pool, lambda one: _fits(fit, one), signals) if pair]
    if is_over() or len(pairs) < len(signals):
        return None
    fits = [one for _, one in pairs]
    before, after = (
        np.concatenate(errors) ** 2 for errors in ([one.misfit for one, _ in pairs], [one.predicted for one in fits])
    )
    first = np.cumsum([0, *(one.freedom + 1 for one in fits)])
    block = np.concatenate([one.block + start for one, start in zip(fits, first, strict=False)])
    evidence = Predictions(before, after, block)
    if not (evidence.gain > 1 - policy.OWN_SHARE and evidence.is_preferred):
        return None
    z = np.array([one.z for one in fits])
    deviations = [one.interval(is_lasting=not is_noise(one.misfit, floor))[0] for one in fits]
    weight = 1 / np.maximum(deviations, 1e-100) ** 2
    mean = np.sum(weight * z, axis=0) / np.maximum(weight.sum(axis=0), 1e-300)
    name = fit.unknowns.names[int(np.argmax(np.sum(weight * (z - mean) ** 2, axis=0)))]
    values = sorted(zip((one.model.parameters[name].value for one in fits), names, strict=True))
    together, own = (math.sqrt(squares.mean()) for squares in (before, after))
    return Differing(name, values[0], values[-1], together, own)


def _fits(fit: Regression, signals: Signals) -> tuple[Regression, Regression] | None:
    """The model on a recording, of which only the nuisance parameters are fitted, and with a fit of its own; None where
    one of them fails."""
    there = None if is_over() else fit_on(fit, signals)
    if there is None:
        return None
    data = replace(there.data, prior_centre=fit.model) if isinstance(there.data, OutputError) else there.data
    own = tried(fit.model, [data], there.nuisance)
    return (there, own) if own else None
