"""A delay, a lag of the actuator, a lag of the sensor: which one it is.  Nothing else is compared here.

To first order in their time T they do the same: what the sensor shows comes later by T.  The search takes the one that
it meets first; once there is a fit, the other ones are as near as can be, and are tried in its place.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

from lostmotion.lab.candidates import others, raced_fits
from lostmotion.lab.heldout import FAR, Judged, Unseen, misfits
from lostmotion.lab.simpler import with_effects
from lostmotion.lab.step import Step, on_unseen
from lostmotion.lab.task import Task
from lostmotion.model import Model

__all__ = ["told_apart"]

LATE = ("command_delay", "actuator_lag", "sensor_lag")
GAIN = 0.003
"""What another one must lower the misfit of unseen data by: ten in log-likelihood, for a recording of 4 s."""


def told_apart(step: Step, before: Judged, unseen: Unseen) -> Step:
    """The accepted step, with another one of LATE in its first fit where that explains the unseen data better.

    before: the fit without its effect; where that was near the noise, what was told apart then still holds.
    """
    first, task = step.tried[0], unseen.task
    if before.error < FAR and first.effect not in LATE:
        return step
    changed = list(_changed(first.level.model, task))
    if not changed:
        return step
    begin = [("", first.level.model), *changed]
    tried = on_unseen(raced_fits(begin, task, unseen.horizon_s, unseen.pool), first.judged, unseen)
    misfit = dict(zip((one.effect for one in tried), misfits([one.judged for one in tried]).tolist(), strict=True))
    best = min(tried, key=lambda one: misfit[one.effect], default=first)
    gain = misfit.get("", math.inf) - misfit.get(best.effect, math.inf)
    if not gain > GAIN:
        return step
    effect = first.effect if first.effect in best.level.model.effects else best.effect
    found = replace(best, effect=effect, misfit=first.misfit - gain)
    return replace(step, tried=(found, *(one for one in step.tried if one.effect != effect)))


def _changed(model: Model, task: Task) -> Iterator[tuple[str, Model]]:
    """What takes the place of one of LATE, and the model with it, of the same T."""
    possible = [effect for effect in LATE if effect in others(model)]
    for old in task.added(model):
        if old in LATE:
            for new in possible:
                effects = [new if one == old else one for one in model.effects]
                yield new, with_effects(model, effects).replace({f"{new}.T": model.parameters[f"{old}.T"].value})
