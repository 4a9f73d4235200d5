"""How the squared torque that a motion needs is divided among effects.  Nothing is fitted here."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lostmotion.lab.inverse.problem import Data
from lostmotion.lab.inverse.torques import inertia_of
from lostmotion.lab.selection.nesting import without
from lostmotion.lab.shooting.least_squares import projected_off
from lostmotion.model import Model
from lostmotion.model.motion import FloatArray

__all__ = ["shares"]


def shares(model: Model, effects: Sequence[str], data: Data, is_free: bool) -> dict[str, float]:
    """By effect, the square of its torque [(N m)²], less what the model's inertia, a constant torque and the effects
    beside these explain of it.

    A spring of a motion of one frequency needs the same torque as an inertia, and the weight of an arm that hardly
    turns is a constant one: such torques cancel, and may be as large as you like.  is_free: of a free motion all
    samples until it rests count.
    """

    def joined(parts: Sequence[FloatArray]) -> FloatArray:
        pairs = zip(parts, data.signals, strict=True)
        return np.concatenate([part[one.moving] if is_free else one.filtered(part) for part, one in pairs])

    whole = data.needed(model)
    torques = {
        name: joined([more - less for more, less in zip(whole, data.needed(without(model, name)), strict=True)])
        for name in model.effects
    }
    moving = joined([inertia_of(model) * one.acceleration for one in data.signals])
    beside = [np.ones(moving.size), *(torque for name, torque in torques.items() if name not in effects)]
    if any(one.torque.any() for one in data.signals):
        beside.append(moving)
    known = np.stack([column / max(float(np.linalg.norm(column)), 1e-300) for column in beside], axis=1)
    return {name: float(np.mean(projected_off(known, torques[name]) ** 2)) for name in effects}
