"""How the torque that a motion needs is divided among effects that share it.  Nothing is fitted to samples over time
here: all laws are linear in their size.

Each effect gets the mean, over all orders in which the effects may be added, of the part of the squared torque that it
explains when its turn comes: the Shapley value, in regression the shares of Lindeman, Merenda and Gold (Grömping 2007,
"Estimators of relative importance in linear regression based on variance decomposition").
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import combinations

import numpy as np

from lostmotion.lab.inverse.problem import Data
from lostmotion.lab.inverse.torques import inertia_of
from lostmotion.lab.selection.nesting import without
from lostmotion.model import Model
from lostmotion.model.motion import FloatArray

__all__ = ["shares"]


def shares(model: Model, effects: Sequence[str], data: Data, is_whole: bool) -> dict[str, float]:
    """By effect, its part of the squared torque [(N m)²].  is_whole: all samples count, not those of the filter.

    What the model has beside these effects, its inertia and a constant torque are fitted in any case.
    """

    def joined(parts: Sequence[FloatArray]) -> FloatArray:
        pairs = zip(parts, data.signals, strict=True)
        return np.concatenate([part if is_whole else one.filtered(part) for part, one in pairs])

    whole = data.needed(model)
    columns = {
        name: joined([more - less for more, less in zip(whole, data.needed(without(model, name)), strict=True)])
        for name in model.effects
    }
    moving = joined([inertia_of(model) * one.acceleration for one in data.signals])
    beside = [np.ones(moving.size), *(column for name, column in columns.items() if name not in effects)]
    is_driven = any(one.torque.any() for one in data.signals)
    target = joined([one.torque for one in data.signals]) if is_driven else moving
    return _shapley(target, [columns[name] for name in effects], [*beside, moving] if is_driven else beside, effects)


def _shapley(
    target: FloatArray, columns: Sequence[FloatArray], beside: Sequence[FloatArray], names: Sequence[str]
) -> dict[str, float]:
    """The mean gain of each column (M,) in the squared target (M,), beside those that are always there."""
    every = np.stack([*beside, *columns, target], axis=1)
    every /= np.maximum(np.linalg.norm(every, axis=0), 1e-300)
    gram, always = every.T @ every, list(range(len(beside)))

    def explained(chosen: tuple[int, ...]) -> float:
        at = [*always, *(len(beside) + one for one in chosen)]
        return float(gram[-1, at] @ np.linalg.lstsq(gram[np.ix_(at, at)], gram[at, -1], rcond=1e-9)[0])

    many, found = len(columns), {}
    known = {chosen: explained(chosen) for size in range(many + 1) for chosen in combinations(range(many), size)}
    for own, name in enumerate(names):
        gains = [
            (known[tuple(sorted((*others, own)))] - value) / math.comb(many - 1, len(others)) / many
            for others, value in known.items()
            if own not in others
        ]
        found[name] = max(sum(gains), 0.0)
    return found
