"""Trials of candidate effects for gears: fits of a model with one more effect, from several initial values.

The score test gives initial values of an effect.  Far from the noise an effect shifts all impacts, and the play fitted
without it is wrong; there a search with observers over effect and play together gives them.  Successive halving on
longer and longer segments then eliminates wrong effects.  The likelihood of gears (likelihood.py) chooses among these
functions.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from lostmotion.lab import policy
from lostmotion.lab.deadline import is_over
from lostmotion.lab.fitting.strategy import doubled, full_fit, repaired_fit, settled
from lostmotion.lab.gears.score_test import Direction
from lostmotion.lab.observer.global_search import FARTHEST, Optimum
from lostmotion.lab.selection.nesting import in_place, merged, others
from lostmotion.lab.shooting.continuation import LONGER, Level, fitted
from lostmotion.lab.shooting.initial_guess import restarts
from lostmotion.lab.shooting.parameters import Unknowns
from lostmotion.lab.shooting.segment import Segment, start_with, state_scales
from lostmotion.lab.shooting.task import Task
from lostmotion.model import Model
from lostmotion.model.effects import get_effect

__all__ = [
    "FEW_STEPS",
    "Trial",
    "delays",
    "full_fits",
    "halving",
    "near_trials",
    "observer_trials",
    "repaired_trial",
    "with_other_delays",
]

FEW_STEPS = 6
"""Steps of fits that only compare effects."""


@dataclass(frozen=True, eq=False)
class Trial:
    """A fit with one more effect; short: the fit on the shortest segments from which it was grown, if there is one."""

    effect: str
    level: Level
    short: Level | None = None


def near_trials(
    level: Level, directions: Sequence[Direction], task: Task, pool: Executor, iterations: int = 15
) -> list[Trial]:
    """Fits with each of these effects on the segments of a level, from the amplitudes of the score test; best first."""
    levels = pool.map(partial(_with_direction, level=level, task=task, iterations=iterations), directions)
    return _ordered([Trial(d.effect, fit) for d, fit in zip(directions, levels, strict=True)])


def observer_trials(found: Sequence[Optimum], task: Task, pool: Executor) -> Iterator[list[Trial]]:
    """Fits on all of the shortest segments that begin at these minima of the prediction error of observers, in two
    batches: with the better half of the effects, then with the others while there is time."""
    names = list(dict.fromkeys(one.effect for one in found))
    half = (len(names) + 1) // 2
    for part in (names[:half], names[half:]):
        if part and (part[0] == names[0] or not is_over()):
            begin = [(one.effect, merged(one.model)) for one in found if one.effect in part]
            yield full_fits(begin, task, pool)


def repaired_trial(effect: str, model: Model, level: Level, task: Task) -> Trial:
    """The fit of a model with other effects from the initial states of a level, after those of missed segments were
    searched for again."""
    return Trial(
        effect, repaired_fit(model, Unknowns.of(model, task.rough), _segments(model, level), task, policy.LOST_SHARE)
    )


def full_fits(begin: Sequence[tuple[str, Model]], task: Task, pool: Executor) -> list[Trial]:
    """Fits of these models, each with the name of its effect, on all of the shortest segments; best first."""
    levels = pool.map(partial(full_fit, task=task, max_missed=policy.LOST_SHARE), [model for _, model in begin])
    return _ordered([Trial(effect, level, level) for (effect, _), level in zip(begin, levels, strict=True)])


def halving(full: Sequence[Trial], task: Task, horizon_s: float, pool: Executor) -> list[Trial]:
    """The trials after fits on longer and longer segments, up to ``horizon_s`` [s]; at each length those are left out
    whose error is ``policy.BEHIND`` times that of the best (successive halving).  One for each effect, best first."""
    trials = _best_of_each(_with_delays(full, task, pool))
    if trials:
        first, *rest = trials
        level = settled(first.level, task)
        trials = _ordered([*_restarted(replace(first, level=level, short=level), task, pool), *rest])
    while trials and trials[0].level.horizon_s * LONGER < horizon_s:
        limit = policy.BEHIND * max(trials[0].level.typical, 1.0)
        running = [trial for trial in trials if trial.level.typical < limit]
        longer_fit = partial(doubled, task=task, max_missed=policy.LOST_SHARE)
        levels = pool.map(longer_fit, [trial.level for trial in running])
        longer = [replace(t, level=level) for t, level in zip(running, levels, strict=True) if level is not None]
        if not longer:
            break
        trials = _ordered(longer)
    return _best_of_each(trials)


def _with_delays(trials: Sequence[Trial], task: Task, pool: Executor) -> list[Trial]:
    """The trials, and fits of the other effects that delay a signal, from the delay of the best such trial: to first
    order they are the same, so that what proposes candidates orders them by chance.  A lag of the sensor that leaves
    a twelfth of the squared error was not proposed beside a delay and a lag of the actuator (seed 7200)."""
    best = next((trial for trial in _ordered(trials) if delays(trial.effect)), None)
    if best is None:
        return [*trials]
    tried = {trial.effect for trial in trials}
    found = with_other_delays(best.level.model, task, best.effect)
    return [*trials, *full_fits([(effect, model) for effect, model in found if effect not in tried], task, pool)]


def with_other_delays(model: Model, task: Task, only: str = "") -> Iterator[tuple[str, Model]]:
    """The models in which an added effect that delays a signal, each or only this one, is replaced by another such
    effect with the same delay, each with the name of the new effect.

    A delay, a lag of the actuator and a lag of the sensor are equal to first order in their time constants, and so is a
    skewed clock in the mean of a recording: a skew of 0.26 ms a second was named a lag of 0.6 ms (seed 7300)."""
    every = [effect for effect in others(model) if delays(effect)]
    for old in [only] if only else [effect for effect in task.added(model) if delays(effect)]:
        name, unit_s = _delay_parameter(old, task)
        if (delay_s := model.parameters[name].value * unit_s) > 0.0:  # no lag may be zero
            for new in every:
                own, own_unit_s = _delay_parameter(new, task)
                other = in_place(model, old, new)
                yield new, other.replace({own: other.parameters[own].clipped(delay_s / own_unit_s)})


def delays(effect: str) -> bool:
    """Whether an effect makes the reading come later."""
    return bool(get_effect(effect).delays_by)


def _delay_parameter(effect: str, task: Task) -> tuple[str, float]:
    """The full name of the parameter by which an effect delays the reading, and the mean delay for each unit of it
    [s]."""
    name = get_effect(effect).delays_by
    if get_effect(effect).parameters[name].unit == "s":
        return f"{effect}.{name}", 1.0
    return f"{effect}.{name}", float(np.mean([np.mean(one.time) - one.clock_zero for one in task.experiments]))


def _restarted(trial: Trial, task: Task, pool: Executor) -> list[Trial]:
    """The trial, and fits of its effect that begin elsewhere, where the cost has many minima: at the neighbours of the
    best whole number (of teeth), until all of them are fitted, and at the ``Effect.restarts``.

    Each begins with initial states of its own: those of another number of teeth miss the impacts (33 led to 35 for the
    39 of a case of seed 6300).  The farthest neighbours are first: from 43 to 16 it took 28 fits with all of them, and
    takes 15 (a case of seed 7700).  Numbers that leave more than the best, by ``policy.LEAST_GAIN``, go no further."""
    found, values = [trial], trial.level.model.own(trial.effect)
    for name in (f"{trial.effect}.{own}" for own, p in values.items() if p.domain.is_whole):
        tried = {trial.level.model.parameters[name].value}
        while near := _next_to(best := _ordered(found)[0].level.model, name, tried):
            tried |= near
            found += full_fits([(trial.effect, best.replace({name: count})) for count in sorted(near)], task, pool)
    leading = _ordered(found)[0].level
    found = [one for one in found if not policy.is_less(leading.typical, one.level.typical)]
    again = [(trial.effect, leading.model.replace(values)) for values in restarts(leading.model, trial.effect)]
    return [*found, *full_fits(again, task, pool)]


def _next_to(model: Model, name: str, tried: set[float]) -> set[float]:
    """The whole numbers that differ by ``FARTHEST`` from that of a parameter, within its bounds, and were not tried; if
    there are none, those that differ by less."""
    p = model.parameters[name]
    far, near = ({p.clipped(p.value + sign * step) for sign in (-1, 1) for step in steps} - tried
                 for steps in ((FARTHEST,), range(1, FARTHEST)))  # fmt: skip
    return far or near


def _best_of_each(trials: Sequence[Trial]) -> list[Trial]:
    """The best trial of each effect, best first."""
    found = dict[str, Trial]()
    for trial in _ordered(trials):
        found.setdefault(trial.effect, trial)
    return list(found.values())


def _ordered(trials: Sequence[Trial]) -> list[Trial]:
    """The trials with a finite error, best first."""
    return sorted((t for t in trials if np.isfinite(t.level.typical)), key=lambda trial: trial.level.typical)


def _with_direction(direction: Direction, level: Level, task: Task, iterations: int) -> Level:
    """The fit with one more effect on the segments of a level, from the amplitude of the score test, within its
    bounds."""
    model, values = direction.model, {}
    for name in get_effect(direction.effect).amplitude_names:
        parameter = model.parameters[name]
        faint = parameter.value
        wanted = faint * direction.amplitude
        values[name] = min(max(wanted, parameter.low, faint if parameter.low >= 0 else parameter.low), parameter.high)
    model = merged(model.replace(values))
    unknowns = Unknowns.of(model, task.rough)
    return fitted(model, unknowns, _segments(model, level), task.substep_s, iterations=iterations)


def _segments(model: Model, level: Level) -> list[Segment]:
    """The segments of a level with initial states for a model with other effects."""
    return [
        replace(
            segment,
            start=start_with(segment.experiment.model(model), segment, level.model.state_names),
            scale=state_scales(model, segment.experiment),
        )
        for segment in level.segments
    ]
