"""The same model with fewer effects, or with a simpler one in the place of another.  Nothing is fitted here."""

from __future__ import annotations

from collections.abc import Sequence

from lostmotion.model import Model, build_model

__all__ = ["SIMPLER", "with_effects"]

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
