"""What follows its input late, with a state of its own: an actuator with a lag or a limit of its speed, a sensor's
filter."""

from __future__ import annotations

import math
from collections.abc import Mapping

from lostmotion.model.base import Operating, Term
from lostmotion.model.effects.base import ActsOn, Effect, joint_sized, on
from lostmotion.model.effects.guesses import MotionScales, Values, grid
from lostmotion.model.effects.words import Words
from lostmotion.model.kernel import Slots, kernel
from lostmotion.model.parameter import Domain, Parameter
from lostmotion.model.signals import COMMAND, OMEGA1, SENSOR, THETA1, TIP

__all__ = ["ACTUATOR_LAG", "SENSOR_LAG", "VELOCITY_LIMIT"]

COMMANDED = ("play", "servo")
SENSED = ("play", "oscillator")
_T = Parameter(1e-3, "s", 5e-5, 0.1, False, "guess: a 160 Hz filter", "time constant", Domain.POSITIVE)


@kernel
def lagged_angle(s: Slots, x: Slots, dx: Slots, p: Slots) -> float:
    """x' = (theta_1 - x)/T; theta_1 becomes x; p: T."""
    dx[0] = (s[THETA1] - x[0]) / p[0]
    return x[0] - s[THETA1]


@kernel
def limited_angle(s: Slots, x: Slots, dx: Slots, p: Slots) -> float:
    """x' = theta_1' + (theta_1 - x)/T within ±omega_max; theta_1 becomes x; p: omega_max, T."""
    dx[0] = min(max(s[OMEGA1] + (s[THETA1] - x[0]) / p[1], -p[0]), p[0])
    return x[0] - s[THETA1]


@kernel
def lagged_rate(s: Slots, x: Slots, dx: Slots, p: Slots) -> float:
    """omega_1 becomes x'."""
    return dx[0] - s[OMEGA1]


@kernel
def low_pass(s: Slots, x: Slots, dx: Slots, p: Slots) -> float:
    """x' = (a - x)/T; the sensor shows x; p: T."""
    dx[0] = (s[SENSOR] - x[0]) / p[0]
    return x[0] - s[SENSOR]


def _rate(values: Mapping[str, float], operating: Operating) -> float:
    return 1 / values["T"]


def _barely(scales: MotionScales) -> list[Values]:
    """A lag faster than the solver's step would not run; a millisecond acts nearly linearly."""
    return [{"T": 1e-3}]


ACTUATOR_LAG = Effect(
    id="actuator_lag",
    equation="T theta_1' + theta_1 = command",
    summary="the actuator follows its command with a first-order lag",
    acts_on=ActsOn.COMMAND,
    bases=COMMANDED,
    parameters={
        "T": Parameter(5e-3, "s", 1e-4, 0.5, False, "guess: a servo's inner loop", "time constant", Domain.POSITIVE)
    },
    terms=on(COMMANDED, Term(THETA1, lagged_angle, ("T",)), Term(OMEGA1, lagged_rate, ("T",))),
    states=(COMMAND,),
    rate=_rate,
    amplitudes=("T",),
    guesses=lambda scales: grid(T=(1.5e-3, 4e-3, 8e-3)),
    barely=_barely,
    delays_by="T",
    words=Words(
        "an actuator that lags",
        "The motor trails behind its command, with a time constant of {T}.",
        "Look at the servo's gains and its limits of speed and acceleration; a low supply voltage makes it slow too.",
    ),
)
VELOCITY_LIMIT = Effect(
    id="velocity_limit",
    equation="|theta_1'| <= omega_max",
    summary="the actuator follows its command no faster than this",
    acts_on=ActsOn.COMMAND,
    bases=("servo",),
    parameters={
        "omega_max": Parameter(2.0, "rad/s", 1e-3, 1e3, False, "guess: a third of an STS3215's speed without a load",
                               "largest speed", Domain.POSITIVE),
        "T": Parameter(5e-4, "s", 1e-4, 0.1, True, "convention: 3e-3 is 1.7 mrad off at reversals",
                       "time constant of the approach to the command", Domain.POSITIVE),
    },
    terms=on(("servo",), Term(THETA1, limited_angle, ("omega_max", "T")), Term(OMEGA1, lagged_rate, ())),
    states=(COMMAND,),
    rate=_rate,
    guesses=lambda scales: grid(omega_max=[share * scales.speed for share in (1.0, 1.25, 1.6, 2.0, 2.5, 3.2)]),
    words=Words(
        "a limit of the speed",
        "The servo follows its command no faster than {omega_max}.",
        "Look at the profile velocity or goal speed that is set in the servo, and whether the commands need more.",
    ),
)  # fmt: skip
SENSOR_LAG = Effect(
    id="sensor_lag",
    equation="T a_s' + a_s = a",
    summary="first-order low-pass of the accelerometer, continuous in time",
    acts_on=ActsOn.SENSOR,
    bases=SENSED,
    parameters={"T": _T},
    defaults={"oscillator": {"T": joint_sized(_T)}},
    terms=on(SENSED, Term(SENSOR, low_pass, ("T",))),
    states=(TIP,),
    rate=_rate,
    amplitudes=("T",),
    guesses=lambda scales: grid(T=[share / (2 * math.pi * scales.resonance) for share in (0.07, 0.35, 1.0)]),
    barely=_barely,
    delays_by="T",
    words=Words(
        "a sensor that smooths",
        "The accelerometer smooths its signal, with a time constant of {T}.",
        "Look at the bandwidth that is set in the sensor, and for a soft mount: foam or thick tape smooths as well.",
    ),
)
