"""The free parameters of a regression: their scales, the prior on them, and the derivatives of the residual by them."""

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
"""Weight of the prior on the base's parameters while a fit is far off: the cost of a factor e, in units of one sample
that is off by the usual motion.  Once the motion is followed it is one sample that is off by the usual misfit.  The
prior keeps parameters that a motion does not identify at their earlier estimates: without it the inertia of a slow
servo went to its lower bound; with the first weight alone the inertia of one that is followed to 0.3 mrad stayed 40 %
too large, and its lag half as long as it is.  Effects have no prior: their first sizes are guesses."""
STEP = 1e-6
"""Finite difference in numbers of order one: the torque is a smooth function of its parameters."""
LEAST_SCALE = 0.01
"""Share of the largest torque, or of a radian: the least scale of a parameter that may be zero."""
LARGEST_BIAS = 2.0
"""Share of the largest torque, the bound of a constant one: with a ripple 2000 times as large it followed a flexible
arm (0009)."""


class FitEndsError(Exception):
    """A fit ends where its derivatives are known."""


def jacobian_of(
    residual: Callable[[FloatArray], FloatArray], z: FloatArray, high: FloatArray, data: Problem, *, may_end: bool
) -> FloatArray:
    """Forward differences (M, P + E), backward at an upper bound; the initial values of all recordings change at once,
    as each recording has its own.  Raises FitEndsError when the time is up, if it may."""
    here = residual(z)
    recordings = len(data.signals)
    count, found = z.size - recordings * data.nuisances, np.zeros((here.size, z.size))
    parts = by_recording(np.arange(here.size), data)
    for at in range(count):
        if may_end and is_over():
            raise FitEndsError
        step = STEP * max(1.0, abs(z[at]))
        step = -step if z[at] + step > high[at] else step
        found[:, at] = (residual(z + step * (np.arange(z.size) == at)) - here) / step
    for k in range(data.nuisances):
        mine = count + k + data.nuisances * np.arange(recordings)
        step = STEP * max(1.0, float(np.abs(z[mine]).max()))
        change = (residual(z + step * np.isin(np.arange(z.size), mine)) - here) / step
        for rows, column in zip(parts, mine, strict=True):
            found[rows, column] = change[rows]
    return found


def prior_of(unknowns: Unknowns, centre: Model | None) -> tuple[FloatArray, FloatArray]:
    """Weights and values of the parameters near which a fit stays (P,) each: those of the base that are positive."""
    weight, near = np.zeros(len(unknowns.items)), np.zeros(len(unknowns.items))
    for at, item in enumerate(unknowns.items):
        if centre and item.logarithmic and "." not in item.name:
            weight[at], near[at] = PRIOR, math.log(centre.parameters[item.name].value)
    return weight, near


def scaled(unknowns: Unknowns, model: Model, data: Problem) -> Unknowns:
    """The unknowns with scales large enough for finite differences even near zero: a share of the torque that moves the
    joint, and of a radian."""
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
