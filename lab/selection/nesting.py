"""The same model with fewer effects, a simpler or a wider one in the place of another.  Nothing is fitted here."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from lostmotion.model import Model, build_model

__all__ = ["SIMPLER", "contained", "in_place", "simpler", "wider", "with_effects", "without"]

SIMPLER = {"stribeck_friction": "coulomb_friction"}
"""What an effect is when one of its parameters says nothing."""
SAME: Mapping[str, tuple[str, ...]] = {"tau_c": ("tau_c", "tau_s")}
"""Which parameters of the whole grow by that of the part, where both act: stick and slip by the same dry friction."""


def with_effects(model: Model, effects: Sequence[str]) -> Model:
    """The model with these effects, with the values that it has or a simpler effect takes over."""
    values = {}
    for name, parameter in model.parameters.items():
        effect, _, own = name.rpartition(".")
        effect = effect if effect in effects else SIMPLER.get(effect, effect)
        values[f"{effect}.{own}" if effect else own] = parameter
    bare = build_model(model.base, effects)
    return bare.replace({name: given for name, given in values.items() if name in bare.parameters})


def in_place(model: Model, old: str, new: str) -> Model:
    """The model with another effect in the place of one of its own, with the values that it has or takes over."""
    return with_effects(model, [new if effect == old else effect for effect in model.effects])


def contained(model: Model, effect: str) -> list[str]:
    """The effects of the model of which this one is a part."""
    return [whole for whole, part in SIMPLER.items() if part == effect and whole in model.effects]


def without(model: Model, effect: str) -> Model:
    """The model without one of its effects; another one of which it is a part goes on with what it did."""
    left = with_effects(model, [other for other in model.effects if other != effect])
    for whole in contained(left, effect):
        for part, grown in SAME.items():
            size = model.parameters[f"{effect}.{part}"].value
            own = {name: left.parameters[name] for name in (f"{whole}.{one}" for one in grown)}
            left = left.replace({name: min(p.value + size, p.high) for name, p in own.items()})
    return left


def simpler(model: Model, effect: str) -> tuple[str, Model] | None:
    """The simpler effect of this one's kind, and the model with it in its place; None where there is none, or the model
    has it already."""
    simple = SIMPLER.get(effect)
    if simple is None or simple in model.effects:
        return None
    return simple, in_place(model, effect, simple)


def wider(model: Model, effect: str) -> tuple[str, Model] | None:
    """The effect of which this one is a part, and the model with it in its place, with the same motion; None where
    there is none."""
    whole = next((whole for whole, part in SIMPLER.items() if part == effect and whole not in model.effects), None)
    if whole is None:
        return None
    own = {
        name.removeprefix(f"{effect}."): p.value
        for name, p in model.parameters.items()
        if name.startswith(f"{effect}.")
    }
    values = {**own, **{grown: own[part] for part, more in SAME.items() for grown in more}}
    return whole, in_place(model, effect, whole).replace({f"{whole}.{name}": value for name, value in values.items()})
