"""The effects that a model lacks; the model without one of its own, or with another in its place.  Nothing is fitted
here."""

from __future__ import annotations

from collections.abc import Sequence

from lostmotion.model import Model, build_model, catalogue
from lostmotion.model.effects import get_effect
from lostmotion.model.effects.base import Simpler

__all__ = [
    "contained",
    "damping_pair",
    "in_place",
    "merged",
    "others",
    "reduced",
    "simplified",
    "wider",
    "with_effects",
    "without",
]


def damping_pair(model: Model) -> tuple[str, ...]:
    """The two effects proportional to the next lower and the next higher power of the speed than a damping of the
    model; () where it has none, or one of them already.  Together they damp a swing as that does, so that neither
    explains anything beside it."""
    powers = {get_effect(name).speed_power for name in model.effects} | ({1} if "b" in model.parameters else set())
    damping = {get_effect(name).speed_power: name for name in others(model)}
    pairs = ((damping.get(power - 1), damping.get(power + 1)) for power in powers if power is not None)
    return next(((low, high) for low, high in pairs if low and high), ())


def with_effects(model: Model, effects: Sequence[str]) -> Model:
    """The model with these effects, with its values, or those that follow from a simpler effect."""
    values = {}
    for name, parameter in model.parameters.items():
        effect, _, own = name.rpartition(".")
        if effect and effect not in effects and (part := get_effect(effect).simpler):
            effect = part.effect
        values[f"{effect}.{own}" if effect else own] = parameter
    bare = build_model(model.base, effects)
    return bare.replace({name: given for name, given in values.items() if name in bare.parameters})


def others(model: Model) -> list[str]:
    """The effects of the catalogue that apply to the model and are not in it, alone or as a part of another one."""
    may = (e.id for e in catalogue() if model.base in e.bases and e.id not in model.effects)
    return [effect for effect in may if get_effect(effect).is_searched and not contained(model, effect)]


def in_place(model: Model, old: str, new: str) -> Model:
    """The model with one of its effects replaced by another, with its values, or those that follow from the replaced
    one."""
    return with_effects(model, [new if effect == old else effect for effect in model.effects])


def contained(model: Model, effect: str) -> list[str]:
    """The effects of the model that contain this one."""
    return [whole for whole, part in _wider_than(effect) if whole in model.effects]


def without(model: Model, effect: str) -> Model:
    """The model without one of its effects; a more general one that contains it takes over its contribution."""
    left = with_effects(model, [other for other in model.effects if other != effect])
    for whole, part in _wider_than(effect):
        if whole not in left.effects:
            continue
        for name, grown in part.grown.items():
            size = model.parameters[f"{effect}.{name}"].value
            own = {full: left.parameters[full] for full in (f"{whole}.{one}" for one in grown)}
            left = left.replace({full: min(p.value + size, p.high) for full, p in own.items()})
    return left


def reduced(model: Model, effect: str, first: Model) -> Model:
    """The model without an effect that a search added to the first one.  A law of the first model that the effect
    contains, and that it replaced, is back."""
    part = _own_part(effect, model, first)
    return in_place(model, effect, part) if part else without(model, effect)


def simplified(model: Model, effect: str, first: Model) -> Model | None:
    """The model with the simpler law that an effect contains in its place; None where there is none, or where the model
    has it, as ``reduced`` has."""
    part = get_effect(effect).simpler
    has_part = not part or part.effect in model.effects or _own_part(effect, model, first)
    return None if has_part or not part else in_place(model, effect, part.effect)


def _own_part(effect: str, model: Model, first: Model) -> str:
    """The effect of the first model that is a part of another one, which took its place; "" for none."""
    part = get_effect(effect).simpler
    return part.effect if part and part.effect in first.effects and part.effect not in model.effects else ""


def merged(model: Model) -> Model:
    """The model without effects that are a part of another one of its effects, which takes over their contribution:
    the data do not distinguish both from one."""
    for effect in model.effects:
        if contained(model, effect):
            model = without(model, effect)
    return model


def wider(model: Model, effect: str) -> tuple[str, Model] | None:
    """The effect of which this one is a part, and the model with it in its place, with the same motion; None where
    there is none."""
    for whole, part in _wider_than(effect):
        if whole in model.effects or model.base not in get_effect(whole).bases:
            continue
        own = {name: p.value for name, p in model.own(effect).items()}
        values = {**own, **{grown: own[name] for name, more in part.grown.items() for grown in more}}
        found = in_place(model, effect, whole)
        return whole, found.replace({f"{whole}.{name}": value for name, value in values.items()})
    return None


def _wider_than(effect: str) -> list[tuple[str, Simpler]]:
    """The effects of the catalogue of which this one is a part, and how."""
    every = ((info.id, get_effect(info.id).simpler) for info in catalogue())
    return [(whole, part) for whole, part in every if part and part.effect == effect]
