"""Effects of one kind: which one it is.  Nothing else is compared here.

A delay, a lag of the actuator and a lag of the sensor do the same to first order in their time T: what the sensor shows
comes later by T.  Coulomb's friction is a part of Stribeck's.  The search takes the one that it meets first; once there
is a fit, the other ones are as near as can be, and are tried in its place.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

from lostmotion.lab import policy
from lostmotion.lab.selection.candidates import halving_fits, others
from lostmotion.lab.selection.nesting import in_place, wider
from lostmotion.lab.selection.step import Step, on_unseen, with_first
from lostmotion.lab.selection.validate import Judged, Unseen, is_left, misfits
from lostmotion.lab.shooting.continuation import Level
from lostmotion.lab.shooting.initial_guess import initial_guesses, scales_of
from lostmotion.lab.shooting.task import Task
from lostmotion.model import Model
from lostmotion.model.effects import get_effect

__all__ = ["distinguished", "generalised"]


def generalised(step: Step, unseen: Unseen) -> Step:
    """The accepted step, with an effect of its first fit generalised to the one of which it is a part, where that
    explains what the part leaves of the unseen data."""
    first = step.tried[0]
    for part in unseen.task.added(first.level.model):
        if (found := wider(first.level.model, part)) and is_left(first.judged):
            whole, model = found
            shapes = ((whole, shape) for shape in _shapes(first.level, model, whole, unseen.task))
            begin = [(part, first.level.model), *shapes]
            levels = {t.effect: t.level for t in halving_fits(begin, unseen.task, unseen.horizon_s, unseen.pool)}
            step = _better_with(step, first.effect, levels.get(part), unseen)
            return _better_with(step, whole if first.effect == part else first.effect, levels.get(whole), unseen)
    return step


def _better_with(step: Step, effect: str, level: Level | None, unseen: Unseen) -> Step:
    """The step with this first fit, where there is one and it is better."""
    if level is None:
        return step
    other = with_first(step, effect, level, unseen)
    return other if unseen.is_better(other.tried[0].judged, step.tried[0].judged) else step


def _shapes(level: Level, model: Model, effect: str, task: Task) -> Iterator[Model]:
    """The model in each shape that this effect may have beside its size."""
    found = initial_guesses(model, effect, scales_of(level.model, level.segments, task.substep_s))
    for shape in {values[f"{effect}.omega_s"] for values in found}:
        yield model.replace({f"{effect}.omega_s": shape})


def distinguished(step: Step, before: Judged, unseen: Unseen) -> Step:
    """The accepted step, with another effect that delays in its first fit where that explains the unseen data better.

    before: the fit without its effect; where that was near the noise, what was told apart then still holds.
    """
    first, task = step.tried[0], unseen.task
    if not unseen.is_far(before.error) and not get_effect(first.effect).delays_by:
        return step
    changed = list(_changed(first.level.model, task))
    if not changed:
        return step
    begin = [("", first.level.model), *changed]
    tried = on_unseen(halving_fits(begin, task, unseen.horizon_s, unseen.pool), first.judged, unseen)
    misfit = dict(zip((one.effect for one in tried), misfits([one.judged for one in tried]).tolist(), strict=True))
    best = min(tried, key=lambda one: misfit[one.effect], default=first)
    gain = misfit.get("", math.inf) - misfit.get(best.effect, math.inf)
    if not gain > policy.DELAY_GAIN:
        return step
    effect = first.effect if first.effect in best.level.model.effects else best.effect
    found = replace(best, effect=effect, misfit=first.misfit - gain)
    return replace(step, tried=(found, *(one for one in step.tried if one.effect != effect)))


def _changed(model: Model, task: Task) -> Iterator[tuple[str, Model]]:
    """What takes the place of an effect that delays, and the model with it, of the same delay."""
    possible = [effect for effect in others(model) if get_effect(effect).delays_by]
    for old in task.added(model):
        if own := get_effect(old).delays_by:
            delay = model.parameters[f"{old}.{own}"].value
            for new in possible:
                yield new, in_place(model, old, new).replace({f"{new}.{get_effect(new).delays_by}": delay})
