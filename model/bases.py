"""Which bases there are."""

from __future__ import annotations

from collections.abc import Mapping

from lostmotion.model import joint, oscillator, play, servo
from lostmotion.model.base import Base
from lostmotion.model.errors import ModelError

__all__ = ["BASES", "get_base"]

BASES: Mapping[str, Base] = {base.id: base for base in (play.BASE, oscillator.BASE, joint.BASE, servo.BASE)}


def get_base(name: str) -> Base:
    """The base of that name.  Raises ModelError naming those that exist."""
    if name not in BASES:
        raise ModelError(f"no base is called {name!r}; there are {', '.join(BASES)}")
    return BASES[name]
