"""The sizes of the effects of a fit: how well it knows them, and the share of each in the torque that a motion needs.
No search and no predictions here."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.special import fdtri, stdtr

from lostmotion.lab import policy
from lostmotion.lab.inverse.problem import InverseModel
from lostmotion.lab.inverse.regression import Regression, blocks_of
from lostmotion.lab.inverse.torques import inertia_of
from lostmotion.lab.selection.nesting import without
from lostmotion.lab.shooting.least_squares import projected_off
from lostmotion.model import Model
from lostmotion.model.effects import get_effect
from lostmotion.model.motion import FloatArray

__all__ = ["amplitudes", "chance_of_zero", "is_sized", "shares", "uncertainty"]


def uncertainty(fit: Regression) -> float:
    """The sum of the logarithms of the relative standard deviations of the sizes of effects."""
    names = {name for effect in fit.model.effects for name in amplitudes(effect, fit)}
    deviations = zip(fit.unknowns.names, fit.deviations(blocks_of(fit)), strict=True)
    sizes = {name: abs(fit.model.parameters[name].value) for name in names}
    return sum(math.log(max(sd, 1e-300) / max(sizes[name], 1e-300)) for name, sd in deviations if name in names)


def chance_of_zero(fewer: Model, fit: Regression) -> float | None:
    """The p-value of Student's t of the effects that a fit has more than another model, robust to correlation within
    blocks (Wald); None where the models are not nested.

    An effect of a few reversals changes few blocks, so that errors by blocks hardly show it; the size of white
    residuals has a known error.  It counts twice, as it is asked after a search without whitening.
    """
    more = set(fit.model.effects) - set(fewer.effects)
    if not more or not set(fewer.effects) < set(fit.model.effects):
        return None
    block = blocks_of(fit)
    deviation = dict(zip(fit.unknowns.names, fit.deviations(block), strict=True))
    chances = [
        min((2 * float(stdtr(int(block.max()), -abs(fit.model.parameters[name].value) / max(deviation[name], 1e-300)))
             for name in amplitudes(effect, fit)), default=1.0)
        for effect in more
    ]  # fmt: skip
    return min(2 * max(chances), 1.0)


def is_sized(effect: str, fit: Regression) -> bool:
    """Whether the interval of an amplitude of the effect excludes zero.  A curve that is nearly a sum of others can
    overfit a motion, and extrapolates badly.  The base's positive parameters are taken as given for a torque: all
    torques of a servo share a scale that its motion does not identify; not for a delay, of which a free kt takes the
    most.  So are others that ended at a bound, as a bar's viscous damping where dry friction and drag are all of it.

    A wave a sin(theta + phi) is zero where both a cos(phi) and a sin(phi) are.  Wald's statistic of the two is a over
    its standard deviation for this phi, squared, and is compared with 2 F(2, n).  By the interval of a alone a weight
    was not identified beside a constant torque: of a swing of 20 degrees one of the two components is their
    difference, and a spring, which a hundredth as many machines have, was named in its place.
    """
    names, block = amplitudes(effect, fit), blocks_of(fit)
    if not names:
        return _is_shaped(effect, fit, block)
    is_torque = any("N" in fit.model.parameters[name].unit for name in names)
    given = [item.name for item in fit.unknowns.items if item.logarithmic and "." not in item.name and is_torque]
    phases = [name for name in fit.unknowns.names if name in _phases(effect, fit.model) and name not in given]
    many = 1 + len(phases)
    width = math.sqrt(many * float(fdtri(many, int(block.max()), policy.CONFIDENCE)))
    limits = width * np.abs(fit.unknowns.slopes(fit.z)) * fit.deviations_within_bounds(block, [*given, *phases])
    sizes = {name: abs(fit.model.parameters[name].value) for name in names}
    return any(sizes[name] > limit for name, limit in zip(fit.unknowns.names, limits, strict=True) if name in sizes)


def _is_shaped(effect: str, fit: Regression, block: NDArray[np.intp]) -> bool:
    """Whether an effect without a fitted size has an identified parameter, or none at all.  A mode with free initial
    values must have an identified frequency: to a mass on a spring with friction, one of 0.001 to 1e6 Hz was fitted;
    and swing ``policy.LEAST_PERIODS`` times: one of a single period was fitted to the slow part of coloured noise."""
    longest = max(one.experiment.duration for one in fit.data.signals)
    swings = [p.value * longest for p in fit.model.own(effect).values() if p.unit == "Hz" and not p.fixed]
    if any(many < policy.LEAST_PERIODS for many in swings):
        return False
    own = [at for at, name in enumerate(fit.unknowns.names) if name.startswith(f"{effect}.")]
    deviation = np.sqrt(np.maximum(np.diag(fit.covariance(block)), 0.0))
    return not own or any(fit.unknowns.items[at].is_identified(fit.z[at], deviation[at]) for at in own)


def _phases(effect: str, model: Model) -> list[str]:
    """The parameters of the effect that are angles, by their full names."""
    return [f"{effect}.{part}" for part, parameter in model.own(effect).items() if parameter.unit == "rad"]


def amplitudes(effect: str, fit: Regression) -> list[str]:
    """The free parameters without which the effect vanishes, by their full names."""
    names = (f"{effect}.{part}" for part in get_effect(effect).amplitudes)
    return [name for name in names if name in fit.unknowns.names]


def shares(model: Model, effects: Sequence[str], data: InverseModel, is_free: bool) -> dict[str, float]:
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
