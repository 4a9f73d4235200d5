"""What an effect is: one more physical term of a model, as one value.  No equations here.

An effect adds contributions to signals and may have states of its own; only the solver integrates.  To write one: a
kernel for each signal it acts on (kernel.py), a row in the registry, a test.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum

from lostmotion.model.base import Operating, Term
from lostmotion.model.effects.guesses import Guesses, Values, no_guesses
from lostmotion.model.effects.words import Words
from lostmotion.model.errors import ModelError
from lostmotion.model.motion import FloatArray
from lostmotion.model.parameter import Parameter

__all__ = [
    "JOINT_MOST",
    "SHAFT_TURNS",
    "ActsOn",
    "Effect",
    "EffectInfo",
    "Simpler",
    "joint_sized",
    "omega_0",
    "on",
    "servo_sized",
    "within_omega_0",
]

JOINT_MOST = 1e9
"""[N m], or that per speed: the base ``joint`` stands for a finger as well as for a crane, in whatever unit its torque
was recorded; the base ``oscillator`` for a tuning fork as well as for a bridge."""
SHAFT_TURNS = 8.0
"""From so many turns on a motion is that of a shaft, and no arm's: pendulums that were swung up covered 3.0 at most,
a screw drive 14 and more, motors 19 to 600."""
SERVO_SIZE = 200.0
"""A servo's torques over those on the bar's small inertia."""


class ActsOn(StrEnum):
    """Where an effect enters."""

    JOINT = "joint"
    OSCILLATOR = "oscillator"
    COMMAND = "command"
    CONTACT = "contact"
    SENSOR = "sensor"


@dataclass(frozen=True)
class Simpler:
    """The effect that another one becomes when one of its parameters has no influence.

    effect: its id; grown: for each of its parameters those of the wider effect that take its value where the wider one
    takes its place.
    """

    effect: str
    grown: Mapping[str, tuple[str, ...]]


@dataclass(frozen=True, kw_only=True, eq=False)
class EffectInfo:
    """The description of an effect: id, equation, summary, parameters by name, where it acts, on which bases.

    It equals only itself: an effect may be registered anew, with other kernels.
    """

    id: str
    equation: str
    summary: str
    acts_on: ActsOn
    parameters: Mapping[str, Parameter]
    bases: tuple[str, ...]


@dataclass(frozen=True, kw_only=True, eq=False)
class Effect(EffectInfo):
    """An effect with its physics, and what a search for missing effects needs to know of it.

    Functions get the values of its parameters and of the base's, by their names in both.
    """

    terms: Mapping[str, tuple[Term, ...]] = field(default_factory=dict)
    """By base, what it adds to signals, in any order.  Names of parameters are its own, or else the base's."""
    states: tuple[int | None, ...] = ()
    """For each state of its own, the signal whose value it begins with, None for zero.  A state that takes the place of
    a signal begins where that stands without this effect."""
    free_states: bool = False
    """Whether these begin anywhere in a motion that no input drives, so that their initial values are its
    amplitudes."""
    along: Callable[[FloatArray, Mapping[str, float]], FloatArray] | None = None
    """For a state that follows from the path of the joint alone, as that of a hysteresis does: its values (N,) along
    these positions (N,) [rad], from zero, in closed form."""
    defaults: Mapping[str, Mapping[str, Parameter]] = field(default_factory=dict)
    """By base, the parameters that are not there as in ``parameters``."""
    rate: Callable[[Mapping[str, float], Operating], float] | None = None
    """The fastest rate that it brings into the motion [rad/s], apart from a change of sign with the speed."""
    sign_width: Callable[[Mapping[str, float], int], float] | None = None
    """The speed within which its change of sign with the speed is smoothed, 0 where there is none; int: the signal of
    the base's speed."""
    delay: Callable[[Mapping[str, float]], float] | None = None
    """The time by which it shifts the input [s]."""
    clock_rate: Callable[[Mapping[str, float]], float] | None = None
    """The rate of the sensor's clock, by which it stretches the time stamps of the readings."""
    is_apt: Callable[[Mapping[str, float]], bool] = lambda values: True
    """Whether these values agree with its definition: a Stribeck friction is largest near rest."""
    is_searched: bool = True
    """Whether a search tries it."""
    amplitudes: tuple[str, ...] = ()
    """The parameters without which it vanishes."""
    guesses: Guesses = no_guesses
    """Initial values of a fit, in a motion of these scales."""
    restarts: Callable[[Mapping[str, float]], Sequence[Values]] = lambda values: ()
    """Initial values of further fits, from the values of a fit, which may have ended in another minimum."""
    barely: Guesses = no_guesses
    """For an effect without an amplitude, values with which it hardly acts, one for each of its shapes."""
    simpler: Simpler | None = None
    """The effect that is a part of it."""
    rivals: tuple[str, ...] = ()
    """Effects that together may look like it; some of them are not searched.  It is named only if it predicts
    better."""
    likelier: str = ""
    """Another effect of its kind, which ``odds`` times as many machines have."""
    odds: float = 1.0
    """See ``likelier``."""
    speed_power: int | None = None
    """The power of the speed to which it is proportional, if it is a damping."""
    most_turns: float = math.inf
    """The number of turns of a motion above which it is no candidate."""
    delays_by: str = ""
    """The parameter by which it makes the reading come later, to first order: by its value, if that is a time T [s]; by
    its value times the time since the sensor's clock was set, if that has no unit, as a skew."""
    rests_by: str = ""
    """For a restoring torque the parameter, its own or the base's, that determines the angle at which it vanishes."""
    words: Words | None = None
    """Its description for a person."""

    @property
    def amplitude_names(self) -> tuple[str, ...]:
        """The names of its amplitudes in a model: "effect.name"."""
        return tuple(f"{self.id}.{name}" for name in self.amplitudes)

    def parameters_on(self, base: str) -> dict[str, Parameter]:
        """Its parameters with their defaults on that base.  Raises ModelError when it does not act there."""
        if base not in self.bases:
            raise ModelError(f"{self.id} does not act on the base {base!r}, only on {', '.join(self.bases)}")
        return {**self.parameters, **self.defaults.get(base, {})}


def on(bases: tuple[str, ...], *terms: Term) -> dict[str, tuple[Term, ...]]:
    """The same terms on each of these bases."""
    return dict.fromkeys(bases, terms)


def omega_0(value: float, low: float = 1e-5, high: float = 1.0, fixed: bool = True) -> Parameter:
    """The speed within which a dry friction is smoothed: sign(omega) ~ tanh(omega/omega_0)."""
    source = "convention: small against the speeds of the motion, large enough for the step"
    about = "speed within which sign(omega) is smoothed"
    return Parameter(value, "rad/s", low, high, fixed, source, about)


def within_omega_0(values: Mapping[str, float], _speed: int) -> float:
    """The ``Effect.sign_width`` of a dry friction with the parameter omega_0."""
    return values["omega_0"]


def servo_sized(torque: Parameter) -> Parameter:
    """The default of a torque, or of a torque per speed, and its bounds as they are on the base ``servo``."""
    value, low, high = (number * SERVO_SIZE for number in (torque.value, torque.low, torque.high))
    return replace(torque, value=value, low=low, high=high)


def joint_sized(parameter: Parameter) -> Parameter:
    """A parameter with a unit, within the bounds that it has on the bases ``joint`` and ``oscillator``: any size."""
    low = -JOINT_MOST if parameter.low < 0 else min(parameter.low, 1 / JOINT_MOST)
    return replace(parameter, low=low, high=JOINT_MOST)
