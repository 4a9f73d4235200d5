"""Distinguishes effects that delay.  Nothing else is compared here.

A delay, a lag of the actuator and a lag of the sensor are equal to first order in their time T: the reading of the
sensor is delayed by T.  The search takes the first one that it tries; the others are then fitted in its place, from
nearly optimal initial values.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

from lostmotion.lab import policy
from lostmotion.lab.selection.candidates import full_fits, halving, others
from lostmotion.lab.selection.nesting import in_place
from lostmotion.lab.selection.step import Step, on_unseen
from lostmotion.lab.selection.validate import Judged, Unseen, misfits
from lostmotion.lab.shooting.task import Task
from lostmotion.model import Model
from lostmotion.model.effects import get_effect

__all__ = ["distinguished"]


def distinguished(step: Step, before: Judged, unseen: Unseen) -> Step:
    """The accepted step, with another effect that delays in its first fit where that explains the unseen data better.

    before: the fit without its effect; where that was near the noise, the distinction made then still holds.
    """
    first, task = step.tried[0], unseen.task
    if not unseen.is_far(before.error) and not get_effect(first.effect).delays_by:
        return step
    changed = list(_changed(first.level.model, task))
    if not changed:
        return step
    short = full_fits([("", first.level.model), *changed], task, unseen.pool)
    tried = on_unseen(halving(short, task, unseen.horizon_s, unseen.pool), first.judged, unseen)
    misfit = dict(zip((one.effect for one in tried), misfits([one.judged for one in tried]).tolist(), strict=True))
    best = min(tried, key=lambda one: misfit[one.effect], default=first)
    gain = misfit.get("", math.inf) - misfit.get(best.effect, math.inf)
    if not gain > policy.ALIKE:
        return step
    effect = first.effect if first.effect in best.level.model.effects else best.effect
    found = replace(best, effect=effect, misfit=first.misfit - gain)
    return replace(step, tried=(found, *(one for one in step.tried if one.effect != effect)))


def _changed(model: Model, task: Task) -> Iterator[tuple[str, Model]]:
    """The alternatives to an effect that delays, each with its model of the same delay."""
    possible = [effect for effect in others(model) if get_effect(effect).delays_by]
    for old in task.added(model):
        if own := get_effect(old).delays_by:
            delay = model.parameters[f"{old}.{own}"].value
            for new in possible:
                yield new, in_place(model, old, new).replace({f"{new}.{get_effect(new).delays_by}": delay})
