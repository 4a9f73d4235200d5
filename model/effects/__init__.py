"""The effects: physical terms that are added to a base, one file an effect or a family.  Nothing is integrated here."""

from lostmotion.model.effects.base import ActsOn, Effect, EffectInfo
from lostmotion.model.effects.registry import catalogue, get_effect, register, unregister

__all__ = ["ActsOn", "Effect", "EffectInfo", "catalogue", "get_effect", "register", "unregister"]
