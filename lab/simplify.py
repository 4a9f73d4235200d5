"""With less as good: effects that others have made superfluous are taken out again.  Nothing is added here.

Effects are found one after the other, and the first may have stood in for one that was found later; or for a base that
had not found its valley, as it has with the effect.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence

from lostmotion.lab.candidates import HOPELESS
from lostmotion.lab.grow import Level
from lostmotion.lab.heldout import Judged, Unseen, better
from lostmotion.lab.search import full_fit, grown
from lostmotion.model import Model, build_model

__all__ = ["simplified"]

SIMPLER = {"stribeck_friction": "coulomb_friction"}
"""What an effect is when one of its parameters says nothing."""
BEHIND = 1.5
"""Times the error on the training data, from which on a simpler model need not be judged."""


def simplified(
    base: Level,
    level: Level,
    descent: Sequence[Judged],
    unseen: Unseen,
    kept: Collection[str] = (),
) -> tuple[Level, list[Judged]]:
    """The simplest fit that does as well on unseen data, and the descent to it.

    level: the fit with all that was found, base: without; descent: judged without, with one, two, … effects; kept:
    effects that unseen data know nothing of.
    """
    for model in _simpler(base.model, level.model, kept):
        fit = full_fit(model, unseen.task, HOPELESS)
        if not fit.typical < BEHIND * level.typical:
            continue
        fit = grown(fit, unseen.task)
        judged = unseen.judge(fit.model)
        if not better(descent[-1], judged, model.base):
            return simplified(base, fit, [*_way(base.model, fit.model, descent[0], unseen), judged], unseen, kept)
    return level, list(descent)


def _simpler(base: Model, model: Model, kept: Collection[str]) -> Iterator[Model]:
    """The model without each of its effects, then with a simpler one in its place; with the values that it has."""
    added = [effect for effect in model.effects if effect not in base.effects and effect not in kept]
    for effect in added:
        yield _with(model, [other for other in model.effects if other != effect])
    for effect in added:
        if (simple := SIMPLER.get(effect)) and simple not in model.effects and len(added) > 1:
            yield _with(model, [simple if other == effect else other for other in model.effects])


def _with(model: Model, effects: Sequence[str]) -> Model:
    values = {}
    for name, parameter in model.parameters.items():
        effect, _, own = name.rpartition(".")
        effect = effect if effect in effects else SIMPLER.get(effect, effect)
        values[f"{effect}.{own}" if effect else own] = parameter
    bare = build_model(model.base, effects)
    return bare.replace({name: given for name, given in values.items() if name in bare.parameters})


def _way(base: Model, model: Model, first: Judged, unseen: Unseen) -> Iterator[Judged]:
    """Judged without, with one, two, … but not all of the effects of the model."""
    added = [effect for effect in model.effects if effect not in base.effects]
    for count in range(len(added)):
        if not count:
            yield first
            continue
        fit = full_fit(_with(model, [*base.effects, *added[:count]]), unseen.task, HOPELESS)
        yield unseen.judge(fit.model)
