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
    """An effect with its physics.

    terms: by base, in any order; their parameters are names of this effect's own, or else of the base's.
    states: for each state of its own, the signal whose value it begins with, or None for zero; a state that takes a
    signal's place begins where that stood *without* this effect.  free_states: whether they begin anywhere in a motion
    that no input drives, so that only their initial values set its amplitudes.  distance: of states that follow from
    the joint's motion alone, as those of a hysteresis do, the shortest way over which they change [rad].  is_searched:
    whether a search for what is missing tries it.  rate: the fastest rate [rad/s] of the effect for its own and the
    base's values, apart from a change of sign with the speed; sign_width: the speed within which that is smoothed, for
    these values and the signal of the base's speed, 0 where its sign does not change.  delay [s] shifts the input,
    clock_rate stretches the sensor's time stamps; both are plain functions of the effect's values, outside the kernels.
    defaults: other values of the parameters on one base.
    is_apt: whether values of its parameters, and of the base's, fit its name: a Stribeck friction is largest near rest.

    For a search: amplitudes: parameters without which it vanishes; guesses: values from which it may begin in a motion
    of these scales; restarts: from the values of a fit, its own and the base's, those from which a fit is begun again,
    as it may have ended in another minimum; barely: values with which it hardly acts, one for each shape, where it has
    no amplitude; simpler: the effect that is a part of it; rivals: effects that together may look like it, some of them
    not searched: it has to predict better than they do; likelier, odds: another effect of its kind, which so many
    times as many machines have; speed_power: the power of the speed to which a damping is proportional; most_turns: a
    motion of more turns cannot have it; delays_by: its parameter T [s] where to first order it makes the reading come
    later by T; delay_rate: its parameter s where to first order it makes the reading come later by s times the time
    since the sensor's clock was set; rests_by: the parameter, of its own or of the base, by which the place where a
    torque pulls the joint to is fitted. words: its description for a person.
    """

    terms: Mapping[str, tuple[Term, ...]] = field(default_factory=dict)
    states: tuple[int | None, ...] = ()
    free_states: bool = False
    distance: Callable[[Mapping[str, float]], float] | None = None
    is_searched: bool = True
    rate: Callable[[Mapping[str, float], Operating], float] | None = None
    sign_width: Callable[[Mapping[str, float], int], float] | None = None
    delay: Callable[[Mapping[str, float]], float] | None = None
    clock_rate: Callable[[Mapping[str, float]], float] | None = None
    defaults: Mapping[str, Mapping[str, Parameter]] = field(default_factory=dict)
    is_apt: Callable[[Mapping[str, float]], bool] = lambda values: True
    amplitudes: tuple[str, ...] = ()
    guesses: Guesses = no_guesses
    restarts: Callable[[Mapping[str, float]], Sequence[Values]] = lambda values: ()
    barely: Guesses = no_guesses
    simpler: Simpler | None = None
    rivals: tuple[str, ...] = ()
    likelier: str = ""
    odds: float = 1.0
    speed_power: int | None = None
    most_turns: float = math.inf
    delays_by: str = ""
    delay_rate: str = ""
    rests_by: str = ""
    words: Words | None = None

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
