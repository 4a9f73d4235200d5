"""Forward selection of effects of gears, as long as there is evidence.  step.py does a single step."""

from __future__ import annotations

import numpy as np

from lostmotion.lab import policy
from lostmotion.lab.deadline import is_over
from lostmotion.lab.fitting.fit import Progress
from lostmotion.lab.fitting.strategy import grown
from lostmotion.lab.selection.alternatives import distinguished
from lostmotion.lab.selection.step import Step, look_ahead, searched
from lostmotion.lab.selection.validate import Judged, Unseen
from lostmotion.lab.shooting.continuation import Level

__all__ = ["descended"]


def descended(
    short: Level, level: Level, unseen: Unseen, rng: np.random.Generator, progress: Progress
) -> tuple[Level, Level, list[Judged], list[Step]]:
    """The last fits on short and on grown segments, the descent of the error, and the steps."""
    descent, steps = [unseen.judge(level.model)], list[Step]()
    while len(descent) <= policy.MOST_MISSING and not (steps and is_over()):
        progress("looking for more" if steps else "looking for what is missing", 0.15 + 0.25 * len(steps))
        found = _next(short, level, descent[-1], unseen, rng)
        steps += found
        if not found[-1].accepted:
            break
        steps[-1] = last = distinguished(found[-1], descent[-1], unseen)
        descent += [step.tried[0].judged for step in (*found[:-1], last)]
        short = last.tried[0].level
        unseen = unseen.with_floor_of(short)
        level = grown(short, unseen.task)
    return short, level, descent, steps


def _next(short: Level, level: Level, now: Judged, unseen: Unseen, rng: np.random.Generator) -> list[Step]:
    """One step, or two where the first explains too little alone.  The last need not be accepted."""
    step = searched(level, short, now, unseen, rng)
    if step.accepted or len(unseen.task.added(short.model)) + 2 > policy.MOST_MISSING or is_over():
        return [step]
    if first := look_ahead(step, now, unseen):
        best = first.tried[0]
        second = searched(best.level, best.level, best.judged, unseen.with_floor_of(best.level), rng)
        if second.accepted and unseen.is_better(second.tried[0].judged, now):
            return [first, second]
    return [step]
