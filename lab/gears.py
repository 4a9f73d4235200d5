"""What is missing from gears with play: their motion is simulated on short segments, each with its own initial state.

``selection`` does the search; this module starts it and turns its result into an Explanation.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import replace

from lostmotion.lab import policy, words
from lostmotion.lab.data.excerpt import excerpts
from lostmotion.lab.data.experiment import Experiment
from lostmotion.lab.deadline import within
from lostmotion.lab.design.next_experiment import what_to_record
from lostmotion.lab.discrepancy.describe import described
from lostmotion.lab.errors import ExperimentError
from lostmotion.lab.fitting.fit import Progress, fit_of, refined_fit
from lostmotion.lab.fitting.identifiability import with_scale
from lostmotion.lab.fitting.strategy import first_fit, full_fit, predictable
from lostmotion.lab.results import Errors, Explanation, Finding, Fit, Ranked, Verdict
from lostmotion.lab.selection.forward import Selection, selected
from lostmotion.lab.selection.score_test import Scores
from lostmotion.lab.selection.step import Step, Tried
from lostmotion.lab.selection.validate import Judged, Unseen, is_left, p_of_gain
from lostmotion.lab.shooting.continuation import FIRST_S
from lostmotion.lab.shooting.task import Task, coarse_substep, dithered, with_friction
from lostmotion.model import Model, ModelError
from lostmotion.model.effects import get_effect

__all__ = ["explained_gears"]

FIRST_LEAST = 8
"""Samples in the first segments, which have four initial values: with three the noise could not be estimated."""
STEP_COST = 0.4
"""Cost of an integration step of gears, relative to that of a sample that is compared."""


def explained_gears(
    model: Model, train: Sequence[Experiment], last: Experiment, noise: dict[str, float], pool: Executor,
    progress: Progress, budget_s: float,
) -> Explanation:  # fmt: skip
    """Finds what is missing, on ``train`` and on ``last``, to which no parameter is fitted.

    noise: floor of each column; budget_s: how long all of it may take [s]; of long recordings a part is used that a
    search can process in this time.  Raises ExperimentError where they were sampled too slowly.
    """
    _check_rate(model, [*train, last])
    model, held = with_scale(model, [*train, last])
    whole_s = sum(one.duration for one in (*train, last))
    train, last = _used(model, train, last, budget_s)
    (*train, last), noise = dithered(model, [*train, last], noise)
    task = Task.of(model, train, noise)
    progress("fitting what is there", 0.0)
    with within(policy.SEARCH_SHARE * budget_s):
        short = first_fit(model, task, pool)
        unseen = Unseen(last, task, predictable(short, task), pool).with_floor_of(short)
        selection = selected(short, unseen, progress)
    progress("refining", 0.9)
    with within((1 - policy.SEARCH_SHARE) * budget_s):
        found = _explanation(selection, task, pool)
    progress("done", 1.0)
    used_s = sum(one.duration for one in (*train, last)), whole_s
    return replace(found, held=held, used_s=used_s)


def _check_rate(model: Model, experiments: Sequence[Experiment]) -> None:
    """Raises ExperimentError where the first segments of gears hold too few samples to determine their initial
    states."""
    slow = min(experiments, key=lambda one: one.rate_hz)
    length = FIRST_S.get(model.base, math.inf)
    if slow.rate_hz * length < FIRST_LEAST:
        raise ExperimentError(
            f"{slow.name}: found {slow.rate_hz:.3g} samples a second, expected at least {FIRST_LEAST / length:.3g}: "
            f"what the teeth of a gear do is over in {length:g} s; of a slow recording the base 'joint' (torque and "
            "position) or 'servo' (command and position) can be asked"
        )


def _used(
    model: Model, train: Sequence[Experiment], last: Experiment, budget_s: float
) -> tuple[list[Experiment], Experiment]:
    """The parts of the experiments to fit, and of the last one, that a search can process in this time."""
    step = coarse_substep(with_friction(model, train), train)
    rate = max(max(one.rate_hz for one in (*train, last)), STEP_COST / step)
    most_s = policy.BUDGET_SAMPLES * budget_s / policy.BUDGET_S / rate
    return excerpts(train, most_s), excerpts([last], most_s / 2)[0]


def _explanation(selection: Selection, task: Task, pool: Executor) -> Explanation:
    """The result with refined estimates, and the remaining error."""
    steps, best, descent = selection.steps, selection.best, selection.descent
    before, after, first = descent[0], descent[-1], next(iter(task.noise))
    named = task.added(best.model)
    refined = pool.submit(refined_fit, best, task)  # runs on one core while the residual is described
    left = is_left(after)
    verdict: Verdict = "missing" if named else "outside_catalogue" if left else "nothing_missing"
    columns = {
        name: Errors(before.of(name), after.of(name), noise, words.column(name)[1])
        for name, noise in task.noise.items()
        if math.isfinite(before.of(name))
    }
    residual = _residual(selection, task) if left else None
    best_fit = refined.result()
    groups = _confusable(named, steps)
    return Explanation(
        verdict=verdict,
        missing=named,
        confusable=groups,
        ranking=_with_intervals(_ranking(steps, before, first), best_fit),
        error=columns[first],
        residual=residual,
        complete=not left,
        advice=_advice(groups[0], steps, task, pool) if groups else "",
        detectable=_detectable(steps[-1].scores) if verdict == "nothing_missing" else {},
        base=_with_unseen(fit_of(selection.base, task), before),
        best=_with_unseen(best_fit, after),
        columns=columns,
        descent=tuple(judged.of(first) for judged in descent),
        left_out=(after.errors.size - len(after.kept), after.errors.size),
        unshown=tuple(effect for effect in selection.unvalidated if effect in named),
        untried=selection.untried,
    )


def _with_unseen(fit: Fit, judged: Judged) -> Fit:
    """The fit with the unseen recording in front, from the initial states that were found there."""
    unseen = (replace(one.experiment, name=f"{one.experiment.name}, not fitted") for one in judged.segments)
    starts = (one.start for one in judged.segments)
    return replace(fit, experiments=(*unseen, *fit.experiments), starts=(*starts, *fit.starts))


def _ranking(steps: Sequence[Step], before: Judged, column: str) -> tuple[Ranked, ...]:
    """The effects of the first search, best first; those that were not fitted by their score, without any gain."""
    if not steps:
        return ()
    step, error = steps[0], before.of(column)
    count = len(step.tried)
    ranked = [
        Ranked(one.effect, error, one.judged.of(column), p_of_gain(one.judged, before, count), _values(one))
        for one in step.tried
    ]
    tried = {entry.effect for entry in ranked}
    rest = (d.effect for d in step.scores.directions if d.effect not in tried)
    return (*ranked, *(Ranked(effect, error, error, 1.0) for effect in rest))


def _with_intervals(ranking: Sequence[Ranked], fit: Fit) -> tuple[Ranked, ...]:
    """Effects that are in the fit get its estimates."""
    known: dict[str, dict[str, tuple[float, float, float]]] = {}
    for e in fit.estimates:
        effect, _, name = e.name.rpartition(".")
        known.setdefault(effect, {})[name] = (e.value, e.low, e.high)
    return tuple(replace(r, parameters={**r.parameters, **known.get(r.effect, {})}) for r in ranking)


def _values(tried: Tried) -> dict[str, tuple[float, float, float]]:
    return {name: (p.value, p.value, p.value) for name, p in tried.level.model.own(tried.effect).items()}


def _confusable(named: Sequence[str], steps: Sequence[Step]) -> tuple[tuple[str, ...], ...]:
    groups = [
        tuple(one.effect for at, one in enumerate(step.equals) if at == 0 or one.effect not in named) for step in steps
    ]
    return tuple(group for group in groups if len(group) > 1 and group[0] in named)


def _advice(effects: Sequence[str], steps: Sequence[Step], task: Task, pool: Executor) -> str:
    """What to record to distinguish the first effects that these recordings confuse."""
    step = next(step for step in steps if step.equals and step.tried[0].effect == effects[0])
    return what_to_record([one.level.model for one in step.equals if one.effect in effects], task, pool)


def _detectable(scores: Scores) -> dict[str, tuple[str, float]]:
    """The amplitude at which each effect's statistic exceeds the limit with probability 1/2."""
    sizes = {}
    for d in scores.directions:
        names = get_effect(d.effect).amplitudes
        if not names or d.statistic <= 0:
            continue
        name = names[0]
        value = d.model.parameters[f"{d.effect}.{name}"].value
        per_sigma = abs(d.amplitude) / math.sqrt(d.statistic)
        sizes[d.effect] = (name, abs(value) * per_sigma * math.sqrt(scores.limit))
    return sizes


def _residual(selection: Selection, task: Task) -> Finding | None:
    """The remaining error, described by a function; None where the model cannot be run."""
    short, best = selection.short, selection.best
    try:
        if short.model.effects != best.model.effects:
            short = full_fit(best.model, task)
        return described(short, task)
    except ModelError:
        return None
