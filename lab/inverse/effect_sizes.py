"""The sizes of the effects of a fit: their uncertainty, tests of whether they are zero, and the torque of each effect.

The likelihood uses them to decide whether an effect is named.  No search and no predictions here.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy.special import fdtri, stdtr, stdtrit

from lostmotion.lab import policy
from lostmotion.lab.inverse.output_error import OutputError
from lostmotion.lab.inverse.problem import InverseModel
from lostmotion.lab.inverse.regression import Regression
from lostmotion.lab.inverse.signals import Signals
from lostmotion.lab.inverse.torques import inertia_of, noise_floor
from lostmotion.lab.selection.nesting import without
from lostmotion.lab.shooting.least_squares import projected_off
from lostmotion.model import Model
from lostmotion.model.effects import get_effect
from lostmotion.model.motion import FloatArray

__all__ = [
    "amplitudes", "chance_of_zero", "disagree", "driven_exceeds_noise", "exceeds_noise", "is_sized", "shares",
    "uncertainty",
]  # fmt: skip


def uncertainty(fit: Regression) -> float:
    """The sum of log(sd/|size|) over the amplitudes of all effects of a fit."""
    sizes = {
        name: abs(fit.model.parameters[name].value) for effect in fit.model.effects for name in amplitudes(effect, fit)
    }
    return sum(math.log(max(fit.deviations[name], 1e-300) / max(size, 1e-300)) for name, size in sizes.items())


def disagree(one: Regression, other: Regression) -> bool:
    """Whether two fits of a model differ significantly (``policy.FALSE_NAME``) in the amplitude of an effect."""
    names = [name for effect in one.model.effects for name in amplitudes(effect, one)]
    distances = [
        abs(one.model.parameters[name].value - other.model.parameters[name].value)
        / max(math.hypot(one.deviations[name], other.deviations[name]), 1e-300)
        for name in names
    ]
    return (
        2 * len(names) * float(stdtr(min(one.freedom, other.freedom), -max(distances, default=0.0))) < policy.FALSE_NAME
    )


def chance_of_zero(fewer: Model, fit: Regression) -> float | None:
    """The p-value of the hypothesis that the effects that a fit has beyond a smaller model are zero (Wald's test,
    robust to correlation within blocks); None where the models are not nested.

    The test is for whitened residuals.  An effect that acts at a few reversals changes few blocks, so that a comparison
    of errors block by block hardly shows it.  The p-value is doubled, as this search follows one without whitening.
    """
    more = set(fit.model.effects) - set(fewer.effects)
    if not more or not set(fewer.effects) < set(fit.model.effects):
        return None
    chances = [
        min((2 * float(stdtr(fit.freedom, -abs(fit.model.parameters[name].value) / max(fit.deviations[name], 1e-300)))
             for name in amplitudes(effect, fit)), default=1.0)
        for effect in more
    ]  # fmt: skip
    return min(2 * max(chances), 1.0)


def is_sized(effect: str, fit: Regression) -> bool:
    """Whether the confidence interval of an amplitude of the effect excludes zero, as a curve that is nearly a sum of
    others can overfit a motion and extrapolates badly.

    For an effect with a torque the positive parameters of the base are taken as given, as all torques of a servo share
    a scale that its motion does not identify.  For a delay they are not, as a free kt imitates most of it.  Parameters
    that ended at a bound are given for the others, as the viscous damping of a bar where dry friction and drag are all
    of it.

    A wave a sin(theta + phi) is zero where both a cos(phi) and a sin(phi) are.  Wald's statistic of the two is the
    square of a over its standard deviation for this phi, and is compared with 2 F(2, n): beside a constant torque a
    small swing identifies only one of the two components of a weight.  A law with a simpler part must differ from it.
    """
    names = amplitudes(effect, fit)
    if not names:
        return _is_shaped(effect, fit)
    if not _departs(effect, fit):
        return False
    is_torque = any("N" in fit.model.parameters[name].unit for name in names)
    given = [item.name for item in fit.unknowns.items if item.logarithmic and "." not in item.name and is_torque]
    phases = [name for name in fit.unknowns.names if name in _phases(effect, fit.model) and name not in given]
    many = 1 + len(phases)
    width = math.sqrt(many * float(fdtri(many, fit.freedom, policy.CONFIDENCE)))
    limits = width * np.abs(fit.unknowns.slopes(fit.z)) * fit.deviations_within_bounds([*given, *phases])
    sizes = {name: abs(fit.model.parameters[name].value) for name in names}
    return any(sizes[name] > limit for name, limit in zip(fit.unknowns.names, limits, strict=True) if name in sizes)


def _departs(effect: str, fit: Regression) -> bool:
    """Whether a confidence interval of what a law has beyond its simpler part excludes zero: of a difference of two
    parameters that are the same one in the simpler law.  A motor that starts from rest seven times had Stribeck
    friction of 130 V near rest, and of 25 V in motion, where the difference had a standard deviation of 59 V."""
    part, names = get_effect(effect).simpler, list(fit.unknowns.names)
    grown = [[f"{effect}.{name}" for name in pair] for pair in (part.grown.values() if part else ())]
    pairs = [pair for pair in grown if len(pair) == 2 and {*pair} <= {*names}]
    if not pairs:
        return True
    width, covariance = -float(stdtrit(fit.freedom, (1 - policy.CONFIDENCE) / 2)), fit.covariance()
    slopes = fit.unknowns.slopes(fit.z)

    def differs(first: str, second: str) -> bool:
        along = slopes * (np.equal(names, first).astype(float) - np.equal(names, second))
        size = fit.model.parameters[first].value - fit.model.parameters[second].value
        return abs(size) > width * math.sqrt(max(float(along @ covariance @ along), 0.0))

    return any(differs(first, second) for first, second in pairs)


def exceeds_noise(fit: Regression) -> bool:
    """Whether a simulated motion leaves more than the noise of its sensor."""
    data = fit.data
    noise = max(data.accuracy, *(one.position_noise for one in data.signals)) if isinstance(data, OutputError) else 0.0
    return isinstance(data, OutputError) and fit.error > policy.STRUCTURED * noise


def driven_exceeds_noise(fit: Regression) -> bool:
    """Whether a motion that an input drives leaves more than noise: that of a measured torque and of the torque which
    the measured motion needs, or of a simulated motion that of its sensor."""
    data = fit.data
    if data.column == InverseModel.column:
        return fit.error > policy.STRUCTURED * max(noise_floor(one, fit.model) for one in data.signals)
    return data.is_driven and exceeds_noise(fit)


def _is_shaped(effect: str, fit: Regression) -> bool:
    """Whether an effect without fitted amplitudes has an identified parameter, or no free parameter at all.

    An effect with a frequency must also cover ``policy.LEAST_PERIODS`` periods in the longest recording, as a single
    period is the slow part of any coloured noise.
    """
    longest = max(one.experiment.duration for one in fit.data.signals)
    swings = [p.value * longest for p in fit.model.own(effect).values() if p.unit == "Hz" and not p.fixed]
    if any(many < policy.LEAST_PERIODS for many in swings):
        return False
    own = [at for at, name in enumerate(fit.unknowns.names) if name.startswith(f"{effect}.")]
    deviation = np.sqrt(np.maximum(np.diag(fit.covariance()), 0.0))
    return not own or any(fit.unknowns.items[at].is_identified(fit.z[at], deviation[at]) for at in own)


def _phases(effect: str, model: Model) -> list[str]:
    """The parameters of the effect that are angles, by their full names."""
    return [f"{effect}.{part}" for part, parameter in model.own(effect).items() if parameter.unit == "rad"]


def amplitudes(effect: str, fit: Regression) -> list[str]:
    """The free parameters without which the effect vanishes, by their full names."""
    return [name for name in get_effect(effect).amplitude_names if name in fit.unknowns.names]


def shares(model: Model, effects: Sequence[str], signals: Sequence[Signals]) -> dict[str, float]:
    """The mean squared torque of each of these effects [(N m)²] at a motion, projected off the torques of the inertia
    (where a torque was measured), of a constant, and of the other effects of the model.

    At a single frequency a spring needs the same torque as an inertia, and the weight of an arm that hardly turns is
    constant.  Such torques can cancel each other, and so may be arbitrarily large.  Of a free motion all samples until
    the part rests count, not only those that are compared.
    """
    data, is_free = InverseModel.of(signals, model), not any(one.torque.any() for one in signals)

    def joined(parts: Sequence[FloatArray]) -> FloatArray:
        pairs = zip(parts, signals, strict=True)
        return np.concatenate([part[one.moving] if is_free else one.filtered(part) for part, one in pairs])

    whole = data.needed(model)
    torques = {
        name: joined([more - less for more, less in zip(whole, data.needed(without(model, name)), strict=True)])
        for name in model.effects
    }
    moving = joined([inertia_of(model) * one.acceleration for one in signals])
    beside = [np.ones(moving.size), *(torque for name, torque in torques.items() if name not in effects)]
    if not is_free:
        beside.append(moving)
    known = np.stack([column / max(float(np.linalg.norm(column)), 1e-300) for column in beside], axis=1)
    return {name: float(np.mean(projected_off(known, torques[name]) ** 2)) for name in effects}
