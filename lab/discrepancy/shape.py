"""Dependence of an estimated input on a state: its mean over the state, and the share that this explains of unseen
segments."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from lostmotion.lab import policy, words
from lostmotion.lab.results import Curve, Finding
from lostmotion.model.motion import FloatArray

__all__ = ["Shape", "finding", "shapes"]

BINS = 16
BLOCK = 0.2
"""Share of the samples that follow each other in one block; blocks are left out in turn."""


@dataclass(frozen=True, eq=False)
class Shape:
    """A series as a function of a variable: mean (K,) at x (K,) with the half width of a 95 % band.

    explained: the share of its variance on segments that were left out, below 0 where it explains nothing.
    """

    variable: str
    unit: str
    x: FloatArray
    mean: FloatArray
    half_width: FloatArray
    explained: float


def shapes(
    u: Sequence[FloatArray], deviations: Sequence[FloatArray], variables: Sequence[Mapping[str, FloatArray]]
) -> tuple[Shape, ...]:
    """The shapes of u over each variable, the best first.

    u, deviations: for each recording (N,), the series and its standard deviation; variables: for each recording, by
    name, (N,).
    """
    y = np.concatenate(u)
    known = np.concatenate(deviations)
    weights = 1.0 / (known**2 + np.median(known) ** 2)
    blocks = np.concatenate([np.arange(x.size) * int(1 / BLOCK) // x.size + 1000 * i for i, x in enumerate(u)])
    found = []
    for name in variables[0]:
        x = np.concatenate([given[name] for given in variables])
        if np.ptp(x) > 0:
            found.append(_shape(name, x, y, weights, blocks))
    return tuple(sorted(found, key=lambda shape: -shape.explained))


def finding(acts_on: str, size: str, unit: str, found: Sequence[Shape]) -> Finding:
    """Describes a residual by its size, in words, and by the state that explains most of it and those that explain
    nearly as much, if any.

    acts_on: the equation; unit: of the residual; found: the best first.
    """
    if not found or found[0].explained < policy.FOLLOWS_STATE:
        return Finding(acts_on, (), f"{size}; it follows no single state")
    best = found[0]
    least = max(policy.FOLLOWS_STATE, policy.FOLLOWS_ALSO * best.explained)
    depends_on = tuple(one.variable for one in found if one is best or one.explained > least)
    text = f"{size}; {100 * best.explained:.0f} % of it follows {words.variable(best.variable)[0]}"
    curve = Curve(
        best.variable, best.unit, best.x, best.mean, best.mean - best.half_width, best.mean + best.half_width, unit
    )
    return Finding(acts_on, depends_on, text, curve)


def _shape(name: str, x: FloatArray, y: FloatArray, weights: FloatArray, blocks: FloatArray) -> Shape:
    edges = np.unique(np.quantile(x, np.linspace(0, 1, BINS + 1)))
    bins = np.clip(np.searchsorted(edges, x, "right") - 1, 0, edges.size - 2)
    ids, block = np.unique(blocks, return_inverse=True)
    shape = (ids.size, edges.size - 1)
    flat = block * shape[1] + bins

    def table(values: FloatArray) -> FloatArray:
        return np.asarray(np.bincount(flat, values, shape[0] * shape[1]).reshape(shape), dtype=float)

    total, weight = table(weights * y), table(weights)
    others_total, others = total.sum(axis=0) - total, weight.sum(axis=0) - weight
    usual = others_total.sum(axis=1) / others.sum(axis=1)
    expected = np.where(others > 0, others_total / np.maximum(others, 1e-300), usual[:, None])[block, bins]
    error = float(np.sum(weights * (y - expected) ** 2))
    before = float(np.sum(weights * (y - usual[block]) ** 2))
    all_weight = np.maximum(weight.sum(axis=0), 1e-300)
    mean = total.sum(axis=0) / all_weight
    scatter = total - weight * mean  # one error for each block: its samples are correlated
    half_width = policy.HALF_WIDTH * np.sqrt(np.sum(scatter**2, axis=0)) / all_weight
    centres = np.bincount(bins, x, shape[1]) / np.maximum(np.bincount(bins, minlength=shape[1]), 1)
    return Shape(name, words.variable(name)[1], centres, mean, half_width, 1 - error / max(before, 1e-300))
