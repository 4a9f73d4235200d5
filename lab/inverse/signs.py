"""Detects a torque with the opposite sign convention, as in files of other programs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from lostmotion.lab import words
from lostmotion.lab.inverse.selection import Search, first_fit, first_step
from lostmotion.lab.inverse.signals import Signals
from lostmotion.model import Model

__all__ = ["advice_of_signs"]


def advice_of_signs(model: Model, signals: Sequence[Signals], search: Search) -> str:
    """The advice where no effect explains a torque, but one does with the other sign, such as a spring that pushes away
    or friction that drives; "" otherwise."""
    turned = [replace(one, torque=-one.torque) for one in signals]
    unseen = search.unseen and replace(search.unseen, torque=-search.unseen.torque)
    other = replace(search, unseen=unseen)
    step = first_step(first_fit(model, turned, other), other)
    if not step.is_accepted:
        return ""
    found = step.judged[0]
    return (
        f"With the torque counted the other way round, {words.name(found.effect)} would explain "
        f"{100 * found.gain:.0f} % of the squared error: if it is measured against the angle, use "
        "--map torque=SERIES*-1."
    )
