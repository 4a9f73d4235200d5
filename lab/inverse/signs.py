"""Whether a torque may be counted against the angle: a file of another program has conventions of its own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from lostmotion.lab import words
from lostmotion.lab.inverse.selection import Search, first_fit, first_step
from lostmotion.lab.inverse.signals import Signals
from lostmotion.model import Model

__all__ = ["advice_of_signs"]


def advice_of_signs(model: Model, signals: Sequence[Signals], search: Search) -> str:
    """What to say where nothing explains a torque, but an effect explains it with the other sign: springs that pushed
    away and friction that drove were outside of the catalogue; "" otherwise."""
    turned = [replace(one, torque=-one.torque) for one in signals]
    unseen = search.unseen and replace(search.unseen, torque=-search.unseen.torque)
    other = replace(search, unseen=unseen)
    step = first_step(first_fit(model, turned, other), other)
    if not step.is_accepted:
        return ""
    found = step.judged[0]
    return (
        f"With the torque counted the other way round, {words.name(found.effect)} would explain "
        f"{100 * found.gain:.0f} % of the squared error: if it is measured against the angle, say "
        "--map torque=SERIES*-1."
    )
