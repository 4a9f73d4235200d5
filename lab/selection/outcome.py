"""The answer of a search in words that do not depend on the likelihood: ranking, shares, what to record next."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import suppress
from itertools import pairwise
from typing import TypeVar

from lostmotion.lab import policy
from lostmotion.lab.data.experiment import Experiment
from lostmotion.lab.deadline import is_over
from lostmotion.lab.design.next_experiment import what_to_record
from lostmotion.lab.results import Estimate, Ranked, Rung
from lostmotion.lab.selection.evidence import Candidate, Fit
from lostmotion.lab.selection.search import Selection
from lostmotion.lab.shooting.task import Task
from lostmotion.model import ModelError

__all__ = ["advice", "ladder", "ranking", "strongest_first", "unshown"]

F = TypeVar("F", bound=Fit)


def strongest_first(
    selection: Selection[F], errors: Sequence[float], power: Mapping[str, float] | None = None
) -> dict[str, float]:
    """For each added effect the part of the squared error that it takes, strongest first.

    errors: on unseen data, of the fits of the selection.  power: what divides the squared error instead, by effect,
    where its torque is known: the first of two effects with similar torques takes what both explain (viscous friction
    before Coulomb friction, of an arm with a tenth of it), and a free swing with gravity alone is soon out of phase
    with the measured one.
    """
    takes = {name: less**2 - more**2 for name, (less, more) in zip(selection.added, pairwise(errors), strict=True)}
    if power:
        total, whole = sum(takes.values()), sum(power.values())
        takes = {name: total * power[name] / max(whole, 1e-300) for name in takes}
    first = max(errors[0] ** 2, 1e-300)
    return {name: takes[name] / first for name in sorted(takes, key=lambda effect: -takes[effect])}


def unshown(selection: Selection[F], error: Callable[[F], float]) -> tuple[str, ...]:
    """The added effects without which no more than is worth a name is left of unseen data: only the data of the fit
    show them.  error: of a fit, on unseen data."""
    least = error(selection.fits[-1])
    return tuple(name for name, fit in selection.lacking.items() if not policy.is_less(least, error(fit)))


def ladder(selection: Selection[F], errors: Sequence[float], noise: float, unit: str) -> tuple[Rung, ...]:
    """The effects of each fit of the selection with its error on unseen data."""
    return tuple(Rung(fit.model.effects, error, noise, unit) for fit, error in zip(selection.fits, errors, strict=True))


def ranking(
    selection: Selection[F], errors: Sequence[float], error: Callable[[Candidate[F]], float],
    estimates: Callable[[F], Sequence[Estimate]], best: Sequence[Estimate],
) -> tuple[Ranked, ...]:  # fmt: skip
    """The added effects in the order of the search, each with the errors on unseen data before and after it, and with
    the estimates of the last fit; then the other candidates of the first step, best first, each alone.

    errors: of the fits of the selection; error: of a candidate; estimates: of the parameters of a fit; best: of the
    last one.  An effect that was not fitted has no gain, and p = 1.
    """
    first = selection.steps[0]
    every = {one.effect: one.p_value for step in selection.steps for one in step.judged}
    p_values = every | {step.judged[0].effect: step.judged[0].p_value for step in selection.steps if step.judged}
    steps = zip(selection.added, pairwise(errors), strict=True)
    found = [Ranked(name, *both, p_values.get(name, math.nan), _own(name, best)) for name, both in steps]
    found += [
        Ranked(
            one.effect, errors[0], error(one), one.p_value, _own(one.effect, estimates(one.fit)), one.is_identified
        )
        for one in first.judged if one.effect not in selection.added
    ]  # fmt: skip
    ranked = {one.effect for one in found}
    return (*found, *(Ranked(name, errors[0], errors[0], 1.0) for name in first.rejected if name not in ranked))


def _own(effect: str, estimates: Sequence[Estimate]) -> dict[str, tuple[float, float, float]]:
    """The estimates of the parameters of an effect, by their own names."""
    return {
        e.name.removeprefix(f"{effect}."): (e.value, e.low, e.high)
        for e in estimates
        if e.name.startswith(f"{effect}.")
    }


def advice(selection: Selection[F], train: Sequence[Experiment], noise: dict[str, float], pool: Executor) -> str:
    """What to record to distinguish the first effects that these recordings confuse; "" where there are none, or where
    their motion cannot be simulated."""
    for step in selection.steps:
        first = step.judged[0].effect if step.judged else ""
        effects = next((group for group in selection.confusable if group[0] == first), ())
        if effects and not is_over():
            alike = [one.fit.model for one in step.judged if one.effect in effects]
            with suppress(ModelError):
                return what_to_record(alike, Task.of(alike[0], train, noise), pool)
            break
    return ""
