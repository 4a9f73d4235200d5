"""The free parameters of a fit as a vector z of numbers of order one.  No data, no simulation.

A positive parameter is exp(z), so that a step is a share of the value; one that may be zero or negative is z times its
scale.  Weak priors (with a standard deviation of a factor e, or of ten scales) keep parameters finite that the data do
not identify.  All fits of the lab use this vector.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from lostmotion.lab import policy
from lostmotion.lab.results import Estimate
from lostmotion.model import Domain, Model, Parameter
from lostmotion.model.motion import FloatArray

__all__ = ["Unknown", "Unknowns", "free_names", "held"]

LOG_PRIOR = 1.0
"""Standard deviation of the prior of a positive parameter, in z: a factor e."""
TRUST: Mapping[str, float] = {"l": 1.25, "k": 1.25, "b": 3.0, "d": 1.8, "alpha": 5.0}
"""The factor by which each parameter of gears may differ in a search from its value in the model file or the
spectra."""
LINEAR_PRIOR = 10.0
"""That of another parameter, in scales."""
AT_BOUND = 1e-6
"""Distance of z from a bound below which a fit ended at the bound, as it approaches a bound from within."""
UNKNOWN = 1e9
"""Half width of an interval, in values or scales of the parameter, or as a factor of a positive one, above which the
interval is infinite, as it follows from rounding."""


def free_names(model: Model) -> tuple[str, ...]:
    """The names of the parameters that a fit may change: those that are neither fixed nor whole numbers."""
    return tuple(name for name, p in model.parameters.items() if not (p.fixed or p.domain.is_whole))


@dataclass(frozen=True)
class Unknown:
    """One free parameter between bounds: its value is exp(z) if it is logarithmic, else scale z; circle: whether it is
    an angle that wraps from high to low."""

    name: str
    low: float
    high: float
    scale: float
    logarithmic: bool
    circle: bool = False

    @classmethod
    def of(cls, name: str, parameter: Parameter) -> Unknown:
        """The unknown that stands for a parameter; its scale is the present value, or a share of its range for zero."""
        low, high = parameter.low, parameter.high
        if parameter.domain is Domain.POSITIVE:
            return cls(name, max(low, 1e-300), high, 1.0, True)
        if parameter.unit == "rad" and math.isclose(high - low, 2 * math.pi):
            return cls(name, low, high, 1.0, False, True)
        if parameter.domain is Domain.SHARE:
            low, high = max(low, 0.01), min(high, 0.99)
        if parameter.domain in (Domain.NOT_NEGATIVE, Domain.SHARE):
            low = max(low, 0.0)
        scale = abs(parameter.value) or _size(low, high)
        return cls(name, low, high, scale, False)

    @property
    def ends(self) -> tuple[float, float]:
        """Lowest and highest z; unbounded for a circular one."""
        return (-math.inf, math.inf) if self.circle else (self.z(self.low), self.z(self.high))

    def z(self, value: float) -> float:
        """The z of a value."""
        return math.log(value) if self.logarithmic else value / self.scale

    def value(self, z: float) -> float:
        """The value of a z, within the bounds."""
        if self.circle:
            return self.low + (z * self.scale - self.low) % (self.high - self.low)
        value = math.exp(min(z, 700.0)) if self.logarithmic else z * self.scale
        return min(max(value, self.low), self.high)

    def interval(self, z: float, half: float) -> tuple[float, float]:
        """The values at z - half and z + half, which may lie outside of the bounds; infinite for a wide interval, see
        ``UNKNOWN``."""
        value = self.value(z)
        if not half < (math.log(UNKNOWN) if self.logarithmic else UNKNOWN * max(abs(z), 1.0)):
            return (0.0 if self.logarithmic else -math.inf), math.inf
        if self.logarithmic:
            return value * math.exp(-half), value * math.exp(half)
        return value - half * self.scale, value + half * self.scale

    def slope(self, z: float) -> float:
        """The derivative of the value by z."""
        return math.exp(min(z, 700.0)) if self.logarithmic else self.scale

    def is_identified(self, z: float, deviation: float) -> bool:
        """Whether a standard deviation of z is below ``policy.IDENTIFIED`` of the value, or of the scale where that is
        larger."""
        return bool(deviation < policy.IDENTIFIED * (1.0 if self.logarithmic else max(abs(z), 1.0)))


def _near(unknown: Unknown, value: float, factor: float) -> Unknown:
    """The unknown with bounds that differ from a value by at most a factor."""
    return replace(unknown, low=max(unknown.low, value / factor), high=min(unknown.high, value * factor))


def _size(low: float, high: float) -> float:
    """The scale of a parameter that starts at zero: a twentieth of its range, or 1 where that is not finite."""
    return (high - low) / 20 if 0.0 < high - low < 1e3 else 1.0


@dataclass(frozen=True, eq=False)
class Unknowns:
    """All free parameters of a model as one vector z (P,)."""

    items: tuple[Unknown, ...]
    prior: FloatArray
    """(P,) standard deviations of the priors in z."""

    @classmethod
    def of(cls, model: Model, around: Model | None = None) -> Unknowns:
        """The free parameters of a model.

        around: a model of gears near whose values (within ``TRUST``) a search stays.  With impacts at wrong times the
        best fit has zero amplitude (regression dilution); bounds prevent this for roughly known parameters.
        """
        items = tuple(Unknown.of(name, model.parameters[name]) for name in free_names(model))
        if around is not None and model.base == "play":
            items = tuple(
                _near(item, around.parameters[item.name].value, TRUST[item.name]) if item.name in TRUST else item
                for item in items
            )
        return cls(items, np.array([LOG_PRIOR if item.logarithmic else LINEAR_PRIOR for item in items]))

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the parameters, in the order of z."""
        return tuple(item.name for item in self.items)

    @property
    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """Lowest and highest z, (P,) each."""
        low, high = np.array([item.ends for item in self.items]).reshape(-1, 2).T
        return low, high

    def z(self, model: Model) -> FloatArray:
        """The vector of the values of a model (P,)."""
        return np.array([item.z(model.parameters[item.name].value) for item in self.items])

    def values(self, z: FloatArray) -> FloatArray:
        """The values of the parameters (P,) at z, of which the first P count."""
        return np.array([item.value(float(x)) for item, x in zip(self.items, z, strict=False)])

    def put(self, model: Model, z: FloatArray) -> Model:
        """The model with the values of a vector (P,).  Raises ModelError for values that are physically impossible."""
        return model.replace({item.name: item.value(float(x)) for item, x in zip(self.items, z, strict=True)})

    def around(self, model: Model, z: FloatArray, step: float) -> tuple[Model, Sequence[tuple[Model, float]]]:
        """The model at z (P,), and for each parameter a model with its z changed by a step, with the step: ``step``, or
        its negative at the upper bound."""
        return _around(self, model, tuple(map(float, z)), step)

    def estimates(self, model: Model, z: FloatArray, deviation: FloatArray, width: float) -> tuple[Estimate, ...]:
        """The parameters of a model with intervals of ``width`` standard deviations of z on either side; deviation: of
        z (P,)."""
        found, bound = [], self.at_bound(z)
        for item, at, sd in zip(self.items, z.tolist(), deviation.tolist(), strict=True):
            ends, unit = item.interval(at, width * sd), model.parameters[item.name].unit
            is_known = item.is_identified(at, sd)
            found.append(Estimate(item.name, item.value(at), *ends, unit, is_known, item.name in bound))
        return tuple(found)

    def at_bound(self, z: FloatArray) -> tuple[str, ...]:
        """The names of the parameters that a fit left at a bound, or beyond it; z: (P,)."""
        return tuple(
            item.name for item, at in zip(self.items, z.tolist(), strict=True)
            if any(math.isclose(at, end, rel_tol=AT_BOUND, abs_tol=AT_BOUND) for end in item.ends)
            or not item.ends[0] < at < item.ends[1]
        )  # fmt: skip

    def slopes(self, z: FloatArray) -> FloatArray:
        """The derivatives of the values by z (P,)."""
        return np.array([item.slope(float(x)) for item, x in zip(self.items, z, strict=True)])


@lru_cache(maxsize=64)  # all segments of a fit need the same models, which cache the solver's tables
def _around(
    unknowns: Unknowns, model: Model, z: tuple[float, ...], step: float
) -> tuple[Model, Sequence[tuple[Model, float]]]:
    at = unknowns.put(model, np.array(z))
    found = []
    for item, value, high in zip(unknowns.items, z, unknowns.bounds[1], strict=True):
        there = value + step if value + step <= high else value - step
        found.append((at.replace({item.name: item.value(there)}), there - value))
    return at, found


def held(model: Model, names: Iterable[str]) -> Model:
    """The model with these parameters fixed at their values."""
    return model.replace({name: replace(model.parameters[name], fixed=True) for name in names})
