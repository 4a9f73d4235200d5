"""The free parameters of a regression: their scales, the prior on them, and the derivatives of the residual by them.

``regression.regressed`` uses these functions; the mapping between parameters and vectors is shooting/parameters.py.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from lostmotion.lab.deadline import is_over
from lostmotion.lab.inverse.problem import Problem, by_recording
from lostmotion.lab.inverse.torques import inertia_of
from lostmotion.lab.shooting.parameters import Unknown, Unknowns
from lostmotion.model import Model
from lostmotion.model.motion import FloatArray

__all__ = ["FitEndsError", "jacobian_of", "prior_of", "scaled"]

PRIOR = 0.1
"""Weight of the prior on the base's parameters while a fit is far off: a factor e costs as much as one sample with an
error of this share of the signal's root mean square.  Once the motion is followed, it costs as much as one sample with
the usual misfit.  The prior keeps parameters that a motion does not identify at their earlier estimates: without it the
inertia of a slow servo went to its lower bound; with the first weight alone the inertia of one that is followed to 0.3
mrad stayed 40 % too large, and its lag half as long as it is.  Effects have no prior: their first sizes are guesses."""
STEP = 1e-6
"""Finite difference in numbers of order one: the torque is a smooth function of its parameters."""
LEAST_SCALE = 0.01
"""Share of the largest torque, or of a radian: the least scale of a parameter that may be zero."""
LARGEST_BIAS = 2.0
"""Largest constant torque, as a share of the largest torque.  Without this bound a constant torque and a ripple 2000
times as large as the torque followed the motion of a flexible arm (docs/decisions/0009)."""


class FitEndsError(Exception):
    """Ends a fit at the last point at which its derivatives are known."""


def jacobian_of(
    residual: Callable[[FloatArray], FloatArray], z: FloatArray, high: FloatArray, data: Problem, *, may_end: bool
) -> FloatArray:
    """The Jacobian (M, P + E) of the residual at z (P + E,), by forward differences, or backward ones at the upper
    bound ``high`` (P + E,).

    The k-th nuisance parameters of all recordings are changed at once, as a recording depends on its own only.
    may_end: whether to raise FitEndsError when the time is up.
    """
    here = residual(z)
    recordings = len(data.signals)
    count, found = z.size - recordings * data.nuisance_count, np.zeros((here.size, z.size))
    parts = by_recording(np.arange(here.size), data)
    for at in range(count):
        if may_end and is_over():
            raise FitEndsError
        step = STEP * max(1.0, abs(z[at]))
        step = -step if z[at] + step > high[at] else step
        found[:, at] = (residual(z + step * (np.arange(z.size) == at)) - here) / step
    for k in range(data.nuisance_count):
        mine = count + k + data.nuisance_count * np.arange(recordings)
        step = STEP * max(1.0, float(np.abs(z[mine]).max()))
        change = (residual(z + step * np.isin(np.arange(z.size), mine)) - here) / step
        for rows, column in zip(parts, mine, strict=True):
            found[rows, column] = change[rows]
    return found


def prior_of(unknowns: Unknowns, centre: Model | None) -> tuple[FloatArray, FloatArray]:
    """The weights and the centres of the prior in z, (P,) each.  Only positive parameters of the base have a prior;
    without a centre none has."""
    weight, near = np.zeros(len(unknowns.items)), np.zeros(len(unknowns.items))
    for at, item in enumerate(unknowns.items):
        if centre and item.logarithmic and "." not in item.name:
            weight[at], near[at] = PRIOR, math.log(centre.parameters[item.name].value)
    return weight, near


def scaled(unknowns: Unknowns, model: Model, data: Problem) -> Unknowns:
    """The unknowns with scales that are large enough for finite differences near zero: at least ``LEAST_SCALE`` of the
    largest torque, or of a radian.  The constant torque of a joint is bounded by ``LARGEST_BIAS``."""
    moving = inertia_of(model) * max(float(np.abs(one.acceleration).max()) for one in data.signals)
    torque = max(moving, *(float(np.abs(one.torque).max()) for one in data.signals))
    usual = {"N m": LEAST_SCALE * torque, "N": LEAST_SCALE * torque, "rad": LEAST_SCALE}
    items = [
        item
        if item.logarithmic
        else replace(item, scale=max(item.scale, usual.get(model.parameters[item.name].unit, 0.0)))
        for item in unknowns.items
    ]
    most = LARGEST_BIAS * torque if model.base == "joint" else math.inf
    return replace(unknowns, items=tuple(_within(item, most) if item.name == "bias" else item for item in items))


def _within(item: Unknown, most: float) -> Unknown:
    """The unknown with its magnitude bounded by ``most``."""
    return replace(item, low=max(item.low, -most), high=min(item.high, most))
