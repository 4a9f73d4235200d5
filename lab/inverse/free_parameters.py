"""The free parameters of a regression: their scales, the prior on them, and the derivatives of the residual by them.

``regression.regressed`` uses these functions; the mapping between parameters and vectors is shooting/parameters.py.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from lostmotion.lab.deadline import FitEndsError, is_over
from lostmotion.lab.inverse.problem import Problem
from lostmotion.lab.inverse.torques import inertia_of
from lostmotion.lab.shooting.parameters import Unknown, Unknowns
from lostmotion.model import Model, ModelError
from lostmotion.model.motion import FloatArray

__all__ = ["Objective", "largest_moving", "possible", "prior_of", "scaled"]

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
times as large as the torque followed the motion of a flexible arm."""
LARGEST = 1e3
"""Largest torque of an effect on a joint without an input, in those of the inertia.  A step of a fit to a wheel that
coasts for 230 s asked for 1e11 of them, whose stiff motion took 40 s to simulate."""


@dataclass(eq=False)
class Objective:
    """The residual of a problem and of the prior at z (P + E,), the parameters and the nuisance parameters, and its
    Jacobian, for a minimiser; both in units of the signal, ``usual``.

    weight, near: (P,), weights and centres of the prior; high: the upper bounds of z (P + E,); most: see ``possible``,
    beyond which a step is not simulated; known: where the Jacobian was evaluated last, with the residual (M + P,) and
    the Jacobian (M + P, P + E) there.
    """

    model: Model
    data: Problem
    unknowns: Unknowns
    usual: float
    weight: FloatArray
    near: FloatArray
    high: FloatArray
    most: FloatArray
    known: tuple[FloatArray, FloatArray, FloatArray] | None = None
    _latest: tuple[FloatArray, FloatArray] | None = None

    def residual(self, z: FloatArray) -> FloatArray:
        """The residual (M + P,); the last one is kept, as a step is evaluated to be judged, and again for its
        derivatives."""
        if self._latest is None or not np.array_equal(self._latest[0], z):
            if not self.known or (np.abs(self.unknowns.values(z)) <= self.most).all():
                found = self._residuals([z])[0]
            else:
                found = np.full_like(self.known[1], np.nan)
            self._latest = z.copy(), found
        return self._latest[1]

    def _residuals(self, every: Sequence[FloatArray]) -> FloatArray:
        """The residuals (K, M + P) at several z (P + E,)."""
        count = len(self.unknowns.items)
        points = [(self.unknowns.put(self.model, z[:count]), z[count:]) for z in every]
        pulls = [self.weight * (z[:count] - self.near) for z in every]
        return np.hstack([self.data.residuals(points) / self.usual, pulls])

    def jacobian(self, z: FloatArray) -> FloatArray:
        """The Jacobian (M + P, P + E), by forward differences, or backward ones at the upper bound.

        The k-th nuisance parameters of all recordings are changed at once, as a recording depends on its own only.
        Raises FitEndsError when the time is up, or where the motion cannot be simulated beside z, if the Jacobian was
        known before; else ModelError.
        """
        if self.known and is_over():
            raise FitEndsError
        data, count, recordings = self.data, len(self.unknowns.items), len(self.data.signals)
        each = (z.size - count) // recordings
        columns = [np.array([at]) for at in range(count)]
        columns += [count + k + each * np.arange(recordings) for k in range(each)]
        steps = [STEP * max(1.0, float(np.abs(z[at]).max())) for at in columns]
        steps[:count] = [-h if x + h > high else h for h, x, high in zip(steps, z[:count], self.high, strict=False)]
        moved = [z + step * np.isin(np.arange(z.size), at) for step, at in zip(steps, columns, strict=True)]
        here, *others = self._residuals([z, *moved])
        with np.errstate(invalid="ignore"):  # of a motion that cannot be simulated
            changes = [(there - here) / step for there, step in zip(others, steps, strict=True)]
        found, parts = np.zeros((here.size, z.size)), data.by_recording(np.arange(sum(data.counts)))
        found[:, :count] = np.transpose(changes[:count]) if count else 0.0
        for at, change in zip(columns[count:], changes[count:], strict=True):
            for rows, column in zip(parts, at, strict=True):
                found[rows, column] = change[rows]
        if np.isfinite(found).all():
            self.known = z.copy(), here, found
        elif self.known:
            raise FitEndsError
        else:
            raise ModelError("the motion cannot be simulated near the first values of the parameters")
        return found


def prior_of(unknowns: Unknowns, centre: Model, misfit: float) -> tuple[FloatArray, FloatArray]:
    """The weights and the centres of the prior in z, (P,) each.  Only positive parameters of the base have a prior;
    misfit: of the fit so far, relative to the signal, infinite or NaN where it cannot be simulated."""
    weight, near = np.zeros(len(unknowns.items)), np.zeros(len(unknowns.items))
    for at, item in enumerate(unknowns.items):
        if item.logarithmic and "." not in item.name:
            weight[at], near[at] = np.fmin(PRIOR, misfit), math.log(centre.parameters[item.name].value)
    return weight, near


def scaled(unknowns: Unknowns, model: Model, data: Problem) -> Unknowns:
    """The unknowns with scales that are large enough for finite differences near zero: at least ``LEAST_SCALE`` of the
    largest torque, or of a radian, and its square of the torque for what is multiplied by the motion: weak damping has
    a thousandth of the torque of a swing.  One that a fit left at nearly zero, as damping beside the drag that explains
    it, would stay there.  The constant torque of a joint is bounded by ``LARGEST_BIAS``."""
    torque = _largest_torque(model, data)
    usual = {unit: LEAST_SCALE**2 * size for unit, size in _per_motion(torque, data).items()}
    usual |= {"N m": LEAST_SCALE * torque, "N": LEAST_SCALE * torque, "rad": LEAST_SCALE}
    items = [
        item
        if item.logarithmic
        else replace(item, scale=max(item.scale, usual.get(model.parameters[item.name].unit, 0.0)))
        for item in unknowns.items
    ]
    most = LARGEST_BIAS * torque if model.base == "joint" else math.inf
    return replace(unknowns, items=tuple(_within(item, most) if item.name == "bias" else item for item in items))


def possible(unknowns: Unknowns, model: Model, data: Problem) -> FloatArray:
    """The largest values of the parameters (P,) that are simulated: of a joint that no input drives ``LARGEST`` times
    the torque of its inertia, or what has it.  A spring whose sensor has its zero elsewhere may have a larger force."""
    if model.base != "joint" or data.is_driven:
        return np.full(len(unknowns.items), math.inf)
    torque = largest_moving(model, data)
    most = {"N m": torque, "N": torque} | _per_motion(torque, data)
    return np.array([LARGEST * most.get(model.parameters[name].unit, math.inf) for name in unknowns.names])


def largest_moving(model: Model, data: Problem) -> float:
    """The largest torque [N m] or force [N] of the inertia."""
    return inertia_of(model) * max(float(np.abs(one.acceleration).max()) for one in data.signals)


def _largest_torque(model: Model, data: Problem) -> float:
    """The largest torque [N m] or force [N] of the inertia, or of those that were measured."""
    return max(largest_moving(model, data), *(float(np.abs(one.torque).max()) for one in data.signals))


def _per_motion(torque: float, data: Problem) -> dict[str, float]:
    """By its unit, what has this torque [N m] or force [N] at the largest speed, or farthest from the middle."""
    speed, place = (
        max(float(np.ptp(values)) for values in parts) / 2
        for parts in ([one.velocity for one in data.signals], [one.position for one in data.signals])
    )
    units = {
        "N m s/rad": speed, "N s/m": speed, "N m s^2/rad^2": speed**2, "N s^2/m^2": speed**2, "N m/rad": place,
        "N/m^3": place**3,
    }  # fmt: skip
    return {unit: torque / motion for unit, motion in units.items() if motion}


def _within(item: Unknown, most: float) -> Unknown:
    """The unknown with its magnitude bounded by ``most``."""
    return replace(item, low=max(item.low, -most), high=min(item.high, most))
