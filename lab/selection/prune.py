"""Backward elimination of effects of gears that others have made superfluous.  Nothing is added here.

Effects are found one after the other, and the first may have imitated one that was found later; or it helped the base
out of a local minimum.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence

from lostmotion.lab import policy
from lostmotion.lab.fitting.fit import fit_of
from lostmotion.lab.fitting.strategy import full_fit, grown
from lostmotion.lab.selection.nesting import simpler, without
from lostmotion.lab.selection.validate import Judged, Unseen
from lostmotion.lab.shooting.continuation import Level
from lostmotion.lab.shooting.task import Task
from lostmotion.model import Model
from lostmotion.model.effects import get_effect

__all__ = ["eliminated", "simplified", "unsized"]


def eliminated(
    level: Level, descent: Sequence[Judged], unseen: Unseen, kept: Collection[str]
) -> tuple[Level, list[Judged]]:
    """The fit without superfluous effects and without those whose size may be zero, and the descent to it; arguments as
    in ``simplified``."""
    level, descent = simplified(level, descent, unseen, kept)
    for effect in unsized(level, unseen.task):
        level, descent = _refitted(without(level.model, effect), level.model, descent, unseen)
    return level, descent


def simplified(
    level: Level, descent: Sequence[Judged], unseen: Unseen, kept: Collection[str] = ()
) -> tuple[Level, list[Judged]]:
    """The simplest fit with an equal error on unseen data, and the descent to it.

    level: the fit with all effects; descent: validated with none, one, two, … effects; kept: effects that the unseen
    data do not show.
    """
    for model in _simpler(level.model, [e for e in unseen.task.added(level.model) if e not in kept]):
        fit, path = _refitted(model, level.model, descent, unseen)
        if not unseen.is_better(unseen.again(level.model, descent[-1], path[-1]), path[-1]):
            return simplified(fit, path, unseen, kept)
    return level, list(descent)


def unsized(level: Level, task: Task) -> list[str]:
    """The added effects without an amplitude that differs significantly from zero.  Only the initial values of their
    states explain something: a second mode that is neither driven nor damped is a hum."""
    if not (added := task.added(level.model)):
        return []
    estimates = {e.name: e for e in fit_of(level, task).estimates}
    found = []
    for effect in added:
        names = (f"{effect}.{name}" for name in get_effect(effect).amplitudes)
        own = [estimates[name] for name in names if name in estimates]
        if own and all(abs(e.value) <= policy.UNSIZED * (e.high - e.low) / 2 for e in own):
            found.append(effect)
    return found


def _refitted(model: Model, before: Model, descent: Sequence[Judged], unseen: Unseen) -> tuple[Level, list[Judged]]:
    """The fit of a simpler model than before, and the descent to it, without the step of an effect that it lacks."""
    task = unseen.task
    fit = grown(full_fit(model, task, policy.LOST_SHARE), task)
    steps = [one for effect, one in zip(task.added(before), descent[1:], strict=True) if effect in model.effects]
    path = [descent[0], *steps][: len(task.added(model))]
    return fit, [*path, unseen.judge(fit.model, descent[-1])]


def _simpler(model: Model, added: Sequence[str]) -> Iterator[Model]:
    """The model without each of these effects, then with a simpler one in its place; with its values."""
    for effect in added:
        yield without(model, effect)
    for effect in added:
        if found := simpler(model, effect):
            yield found[1]
