"""User-defined effects: a decorated Python function, in a file or a notebook, becomes a term of the model."""

from lostmotion.lab.models.own.decorator import OwnEffect, effect
from lostmotion.lab.models.own.file import is_reference, load_effect, reference

__all__ = ["OwnEffect", "effect", "is_reference", "load_effect", "reference"]
