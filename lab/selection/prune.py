"""With less as good: effects that others have made superfluous are taken out again.  Nothing is added here.

Effects are found one after the other, and the first may have stood in for one that was found later; or for a base that
had not found its valley, as it has with the effect.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence

from lostmotion.lab.fitting.strategy import full_fit, grown
from lostmotion.lab.selection.candidates import HOPELESS
from lostmotion.lab.selection.nesting import simpler, with_effects, without
from lostmotion.lab.selection.validate import Judged, Unseen, better
from lostmotion.lab.shooting.continuation import Level
from lostmotion.model import Model

__all__ = ["simplified"]

BEHIND = 1.5
"""Times the error on the training data, from which on a simpler model need not be judged."""


def simplified(
    level: Level,
    descent: Sequence[Judged],
    unseen: Unseen,
    kept: Collection[str] = (),
) -> tuple[Level, list[Judged]]:
    """The simplest fit that does as well on unseen data, and the descent to it.

    level: the fit with all that was found; descent: judged without, with one, two, … effects; kept: effects that
    unseen data know nothing of.
    """
    for model in _simpler(level.model, [e for e in unseen.task.added(level.model) if e not in kept]):
        fit = full_fit(model, unseen.task, HOPELESS)
        if not fit.typical < BEHIND * level.typical:
            continue
        fit = grown(fit, unseen.task)
        judged = unseen.judge(fit.model, descent[-1])
        if not better(unseen.again(level.model, descent[-1], judged), judged, model.base):
            return simplified(fit, [*_way(fit.model, descent[0], unseen), judged], unseen, kept)
    return level, list(descent)


def _simpler(model: Model, added: Sequence[str]) -> Iterator[Model]:
    """The model without each of these effects, then with a simpler one in its place; with the values that it has."""
    for effect in added:
        yield without(model, effect)
    for effect in added if len(added) > 1 else ():
        if found := simpler(model, effect):
            yield found[1]


def _way(model: Model, first: Judged, unseen: Unseen) -> Iterator[Judged]:
    """Judged without, with one, two, … but not all of what was added to the model."""
    task, added = unseen.task, unseen.task.added(model)
    if added:
        yield first
    for count in range(1, len(added)):
        fit = full_fit(with_effects(model, [*task.rough.effects, *added[:count]]), task, HOPELESS)
        yield unseen.judge(fit.model)
