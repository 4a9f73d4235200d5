"""The same model with fewer effects, or with a simpler one in the place of another.  Nothing is fitted here."""

from __future__ import annotations

from collections.abc import Sequence

from lostmotion.model import Model, build_model

__all__ = ["simpler", "with_effects"]

SIMPLER = {"stribeck_friction": "coulomb_friction"}
"""What an effect is when one of its parameters says nothing."""


def with_effects(model: Model, effects: Sequence[str]) -> Model:
    """The model with these effects, with the values that it has or a simpler effect takes over."""
    values = {}
    for name, parameter in model.parameters.items():
        effect, _, own = name.rpartition(".")
        effect = effect if effect in effects else SIMPLER.get(effect, effect)
        values[f"{effect}.{own}" if effect else own] = parameter
    bare = build_model(model.base, effects)
    return bare.replace({name: given for name, given in values.items() if name in bare.parameters})


def simpler(model: Model, effect: str) -> tuple[str, Model] | None:
    """The simpler effect of this one's kind, and the model with it in its place; None where there is none, or the model
    has it already."""
    simple = SIMPLER.get(effect)
    if simple is None or simple in model.effects:
        return None
    return simple, with_effects(model, [simple if other == effect else other for other in model.effects])
