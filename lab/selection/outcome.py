"""The answer of a search in words that do not depend on the likelihood: ranking, shares, what to record next."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import suppress
from itertools import pairwise
from typing import TypeVar

import numpy as np

from lostmotion.lab.data.experiment import Experiment
from lostmotion.lab.deadline import is_over
from lostmotion.lab.design.next_experiment import what_to_record
from lostmotion.lab.results import Estimate, Ranked
from lostmotion.lab.selection.evidence import Candidate, Fit
from lostmotion.lab.selection.forward import Selection
from lostmotion.lab.shooting.task import Task
from lostmotion.model import ModelError

__all__ = ["advice", "ranking", "strongest_first"]

F = TypeVar("F", bound=Fit)


def strongest_first(
    errors: Sequence[float], selection: Selection[F], power: Mapping[str, float] | None = None
) -> tuple[tuple[str, ...], tuple[float, ...]]:
    """The added effects, strongest first; and the error with none of them, with the first, with the first two, …

    The strongest effect takes most of the squared error; several steps of one effect are added up.  power: what divides
    the squared error instead, by effect, where its torque is known: the first of two effects with similar torques takes
    what both explain (viscous friction before Coulomb friction, of an arm with a tenth of it), and a free swing
    simulated with gravity alone is out of phase with the measured one.
    """
    takes = dict.fromkeys(selection.added, 0.0)
    for effect, (less, more) in zip(selection.labels, pairwise(errors), strict=True):
        takes[effect] += less**2 - more**2
    if power:
        total, whole = sum(takes.values()), sum(power.values())
        takes = {name: total * power[name] / max(whole, 1e-300) for name in takes}
    missing = sorted(takes, key=lambda effect: -takes[effect])
    left = errors[0] ** 2 - np.cumsum([0.0, *(takes[effect] for effect in missing)])
    return tuple(missing), tuple(np.sqrt(np.maximum(left, 0.0)).tolist())


def ranking(
    selection: Selection[F], before: float, error: Callable[[Candidate[F]], float],
    estimates: Callable[[F], Sequence[Estimate]], best: Sequence[Estimate],
) -> tuple[Ranked, ...]:  # fmt: skip
    """The candidates of the first step, best first, with errors on the last recording; those that were added with the
    estimates of the last fit, and with the p-value of the step that added them: what a second effect takes may show
    only beside the first, or where the misfit is whitened.  An effect that was not fitted has no gain, and p = 1."""
    first = selection.steps[0]
    leading = [step.judged[0] for step in selection.steps if step.judged]
    added = {one.effect: one.p_value for one in leading if one.effect in selection.added}

    def values(one: Candidate[F]) -> dict[str, tuple[float, float, float]]:
        found = [*estimates(one.fit), *(best if one.effect in selection.added else ())]
        own = [e for e in found if e.name.startswith(f"{one.effect}.")]
        return {e.name.removeprefix(f"{one.effect}."): (e.value, e.low, e.high) for e in own}

    ranked = [
        Ranked(one.effect, before, error(one), added.get(one.effect, one.p_value), values(one), one.is_identified)
        for one in first.judged
    ]
    fitted = {one.effect for one in ranked}
    return (*ranked, *(Ranked(name, before, before, 1.0) for name in first.rejected if name not in fitted))


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
