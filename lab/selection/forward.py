"""Forward selection of effects of gears, as long as there is evidence, and elimination at the end.  step.py does a
single step."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lostmotion.lab import policy
from lostmotion.lab.deadline import is_over
from lostmotion.lab.fitting.fit import Progress
from lostmotion.lab.fitting.strategy import grown
from lostmotion.lab.selection.alternatives import distinguished
from lostmotion.lab.selection.candidates import others
from lostmotion.lab.selection.prune import eliminated
from lostmotion.lab.selection.step import Step, look_ahead, searched
from lostmotion.lab.selection.validate import Judged, Unseen
from lostmotion.lab.shooting.continuation import Level

__all__ = ["Selection", "selected"]


@dataclass(frozen=True, eq=False)
class Selection:
    """base: the fit of the model as it is; best, short: the last fit, on long and on short segments; descent: validated
    with none, one, two, … of the effects; steps: what was tried; untried: effects that were not fitted because the time
    was up.
    """

    base: Level
    best: Level
    short: Level
    descent: Sequence[Judged]
    steps: Sequence[Step]
    untried: tuple[str, ...]

    @property
    def unvalidated(self) -> list[str]:
        """The effects that were accepted although the unseen data do not show them."""
        return _unvalidated(self.steps)


def selected(short: Level, unseen: Unseen, progress: Progress) -> Selection:
    """Adds effects to the fit on the shortest segments as long as one is accepted and there is time, then eliminates
    those that have become superfluous."""
    rng, level, beside = np.random.default_rng(0), grown(short, unseen.task), unseen
    base, descent, steps = level, [unseen.judge(level.model)], list[Step]()
    while len(descent) <= policy.MOST_MISSING and not (steps and is_over()):
        progress("looking for more" if steps else "looking for what is missing", 0.15 + 0.25 * len(steps))
        now = descent[-1]
        found = [searched(level, short, now, beside, rng)]
        if not found[0].accepted and len(descent) < policy.MOST_MISSING and not is_over():
            found = look_ahead(found[0], now, beside, rng) or found
        steps += found
        if not found[-1].accepted:
            break
        steps[-1] = distinguished(found[-1], now, beside)
        descent += [step.tried[0].judged for step in steps[-len(found) :]]
        short = steps[-1].tried[0].level
        beside = unseen.with_floor_of(short)
        level = grown(short, unseen.task)
    best, path = eliminated(level, descent, unseen, _unvalidated(steps))
    tried = {one.effect for one in steps[-1].tried}
    untried = tuple(effect for effect in others(best.model) if effect not in tried) if is_over() else ()
    return Selection(base, best, short, path, steps, untried)


def _unvalidated(steps: Sequence[Step]) -> list[str]:
    return [step.tried[0].effect for step in steps if step.unvalidated]
