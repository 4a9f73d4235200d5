"""The search for missing effects in gears with play: its preparation and its result.

The search itself is selection/forward.py, with the likelihood of gears (likelihood.py).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from concurrent.futures import Executor
from contextlib import suppress
from dataclasses import replace

from lostmotion.lab import policy, words
from lostmotion.lab.data.excerpt import excerpts
from lostmotion.lab.data.experiment import Experiment
from lostmotion.lab.deadline import Progress, within
from lostmotion.lab.discrepancy.describe import described
from lostmotion.lab.fitting.fit import fit_of, refined_fit
from lostmotion.lab.fitting.identifiability import with_scale
from lostmotion.lab.fitting.strategy import full_fit, predictable, searched_fit
from lostmotion.lab.gears.input_error import input_error
from lostmotion.lab.gears.likelihood import SegmentFit, ShortSegments
from lostmotion.lab.gears.unseen import Unseen, Validation, exceeds_noise
from lostmotion.lab.results import Errors, Estimate, Explanation, Finding, Fit
from lostmotion.lab.selection.forward import selected
from lostmotion.lab.selection.outcome import advice, ladder, ranking, strongest_first, unshown
from lostmotion.lab.selection.search import Selection
from lostmotion.lab.shooting.continuation import Level
from lostmotion.lab.shooting.task import Task, coarse_substep, dithered
from lostmotion.model import Model, ModelError

__all__ = ["explained_gears"]

STEP_COST = 0.4
"""Cost of an integration step of gears, relative to that of a sample that is compared."""


def explained_gears(
    model: Model, train: Sequence[Experiment], last: Experiment, noise: dict[str, float], pool: Executor,
    progress: Progress, budget_s: float, spent_s: float,
) -> Explanation:  # fmt: skip
    """Searches the effects that are missing from a model of gears.

    train: the experiments of the fits; last: the one that is predicted, to which no parameter is fitted; noise: root
    mean square of the noise of each column; budget_s, spent_s: time of the search, and the part of it that has gone
    [s].  Of long recordings those parts are used that a search can process in the whole time, so that the answer does
    not depend on how fast the files were read.
    """
    model, held = with_scale(model, [*train, last])
    whole_s = sum(one.duration for one in (*train, last))
    train, last = _used(model, train, last, budget_s)
    known, sensor = input_error(model, last, noise, pool), noise
    (*train, last), noise = dithered(model, [*train, last], sensor, known.columns)
    task = replace(Task.of(model, train, noise), longest_s=known.longest_s, input_share=known.share(noise))
    left_s = budget_s - spent_s
    progress("fitting what is there", 0.0)
    with within(policy.STAGE_SHARE * left_s):
        short = searched_fit(model, task, pool)
        unseen = Unseen(last, task, predictable(short, task), pool)
        selection = selected(ShortSegments(short, unseen), progress)
    progress("refining", 0.9)
    with within((1 - policy.STAGE_SHARE) * left_s):
        found = _explanation(selection, task, pool)
    refined_fit.cache_clear()
    progress("done", 1.0)
    used_s = sum(one.duration for one in (*train, last)), whole_s
    return replace(found, held=held, used_s=used_s, input_limit=known.limit(last, sensor))


def _used(
    model: Model, train: Sequence[Experiment], last: Experiment, budget_s: float
) -> tuple[list[Experiment], Experiment]:
    """The parts of the experiments of the fits, and of the last one, that a search can process in a time [s]."""
    step = coarse_substep(model, train)
    rate = max(max(one.rate_hz for one in (*train, last)), STEP_COST / step)
    most_s = policy.BUDGET_SAMPLES * budget_s / policy.BUDGET_S / rate
    return excerpts(train, most_s), excerpts([last], most_s / 2)[0]


def _explanation(selection: Selection[SegmentFit], task: Task, pool: Executor) -> Explanation:
    """The result of a search, with refined estimates and a description of the remaining error."""
    base, best, column = selection.fits[0], selection.fits[-1], next(iter(task.noise))
    before, after = base.unseen, best.unseen
    errors = [one.unseen.of(column) for one in selection.fits]
    share = strongest_first(selection, errors)
    refined = pool.submit(refined_fit, best.level, task)  # runs on one core while the residual is described
    left = exceeds_noise(after)
    columns = {
        name: Errors(before.of(name), after.of(name), noise, words.column(name)[1])
        for name, noise in task.noise.items()
        if math.isfinite(before.of(name))
    }
    residual = _residual(best.short, best.model, task) if left else None
    best_fit = refined.result()
    return Explanation(
        missing=tuple(share),
        share=share,
        unshown=unshown(selection, lambda one: one.unseen.of(column)),
        confusable=_confusable(selection),
        ranking=ranking(selection, errors, lambda one: one.fit.unseen.of(column), _values, best_fit.estimates),
        error=columns[column],
        residual=residual,
        complete=not left,
        advice=advice(selection, task.experiments, task.noise, pool),
        detectable=selection.steps[-1].detectable if not (share or left) else {},
        base=_with_unseen(fit_of(base.level, task), before),
        best=_with_unseen(best_fit, after),
        columns=columns,
        rungs=ladder(selection, errors, columns[column].noise, columns[column].unit),
        left_out=(after.errors.size - len(after.kept), after.errors.size),
        untried=selection.untried,
    )


def _confusable(selection: Selection[SegmentFit]) -> tuple[tuple[str, ...], ...]:
    """The confusable groups of the search, completed by the delaying effects that predict as well as a named one."""
    groups = {group[0]: group for group in selection.confusable}
    for named, other in selection.fits[-1].alike:
        if named in selection.added and other not in (group := groups.get(named, (named,))):
            groups[named] = (*group, other)
    return tuple(groups.values())


def _with_unseen(fit: Fit, validation: Validation) -> Fit:
    """The fit with the segments of the unseen recording in front, and their estimated initial states."""
    unseen = (replace(one.experiment, name=f"{one.experiment.name}, not fitted") for one in validation.segments)
    starts = (one.start for one in validation.segments)
    return replace(fit, experiments=(*unseen, *fit.experiments), starts=(*starts, *fit.starts))


def _values(fit: SegmentFit) -> list[Estimate]:
    """The parameters of a candidate, without intervals."""
    return [Estimate(name, p.value, p.value, p.value, p.unit) for name, p in fit.model.parameters.items()]


def _residual(short: Level, best: Model, task: Task) -> Finding | None:
    """The remaining error, described by an unknown function; None where the model cannot be simulated.  short: the best
    fit on the shortest segments, if its effects are those of the best model."""
    with suppress(ModelError):
        return described(short if short.model.effects == best.effects else full_fit(best, task), task)
    return None
