"""What the accelerometer adds: gravity on a tilted axis, centripetal crosstalk, saturation, drift."""

from __future__ import annotations

import math

from lostmotion.model.base import Term
from lostmotion.model.effects.base import ActsOn, Effect, joint_sized, on
from lostmotion.model.effects.guesses import PHASES, grid
from lostmotion.model.effects.words import Words
from lostmotion.model.elementary import sine
from lostmotion.model.kernel import Slots, kernel
from lostmotion.model.parameter import Domain, Parameter
from lostmotion.model.signals import OMEGA2, READING, THETA2, TIME, TIP

__all__ = ["BIAS_DRIFT", "CENTRIPETAL_CROSSTALK", "GRAVITY_LEAKAGE", "SENSOR_SATURATION"]

SENSED = ("play", "oscillator")
_C = Parameter(0.01, "m/s^3", -10.0, 10.0, False, "guess", "drift")
_A_MAX = Parameter(19.6, "m/s^2", 0.1, 2000.0, False, "a 2 g range", "range", Domain.POSITIVE)
G = 9.80665
"""Standard gravity [m/s²]."""


@kernel
def leakage(s: Slots, x: Slots, dx: Slots, p: Slots) -> float:
    """c g sin(theta_2 + phi); p: c, phi."""
    return p[0] * G * sine(s[THETA2] + p[1])


@kernel
def centripetal(s: Slots, x: Slots, dx: Slots, p: Slots) -> float:
    """c omega² l; p: c, l."""
    return p[0] * s[OMEGA2] ** 2 * p[1]


@kernel
def drift(s: Slots, x: Slots, dx: Slots, p: Slots) -> float:
    """c t; p: c."""
    return p[0] * s[TIME]


@kernel
def saturation(s: Slots, x: Slots, dx: Slots, p: Slots) -> float:
    """The reading is clipped at ±a_max; p: a_max."""
    return min(max(s[READING], -p[0]), p[0]) - s[READING]


GRAVITY_LEAKAGE = Effect(
    id="gravity_leakage",
    equation="accel += c g sin(theta_2 + phi)",
    summary="gravity leaks into the reading because the axis is tilted",
    acts_on=ActsOn.SENSOR,
    bases=("play",),
    parameters={
        "c": Parameter(0.05, "", -1.0, 1.0, False, "guess: an axis 3 deg off", "share of gravity"),
        "phi": Parameter(0.0, "rad", -math.pi, math.pi, False, "guess", "angle at theta_2 = 0"),
    },
    terms=on(("play",), Term(TIP, leakage, ("c", "phi"))),
    amplitudes=("c",),
    guesses=lambda scales: grid(c=(0.02, 0.1), phi=PHASES),
    words=Words(
        "gravity in the sensor",
        "The accelerometer feels gravity, as if its axis were tilted by {c.size.tilt}.",
        "Look whether the sensor sits square on its bar, and whether the joint's axis is vertical.",
        read_as={"c": "tilt"},
    ),
)
CENTRIPETAL_CROSSTALK = Effect(
    id="centripetal_crosstalk",
    equation="accel += c omega^2 l",
    summary="centripetal acceleration leaks into the tangential axis",
    acts_on=ActsOn.SENSOR,
    bases=("play",),
    parameters={"c": Parameter(0.05, "", -20.0, 20.0, False, "guess: a sensor turned by 3 deg", "crosstalk")},
    terms=on(("play",), Term(TIP, centripetal, ("c", "l"))),
    amplitudes=("c",),
    guesses=lambda scales: grid(c=(0.3,)),
    words=Words(
        "centripetal acceleration in the sensor",
        "The accelerometer feels the centripetal acceleration, as if it were turned on its bar by {c.size.tilt}.",
        "Look whether the sensor's axis stands square to the bar, and whether its screws or its tape are loose.",
        read_as={"c": "tilt"},
    ),
)
BIAS_DRIFT = Effect(
    id="bias_drift",
    equation="accel += c t",
    summary="the offset drifts, as when the sensor warms up",
    acts_on=ActsOn.SENSOR,
    bases=SENSED,
    parameters={"c": _C},
    defaults={"oscillator": {"c": joint_sized(_C)}},
    terms=on(SENSED, Term(READING, drift, ("c",))),
    amplitudes=("c",),
    guesses=lambda scales: grid(c=(scales.reading / scales.length * 0.01,)),
    words=Words(
        "a sensor that drifts",
        "The accelerometer's zero drifts by {c}.",
        "Let the sensor warm up before recording; look for a supply voltage that sags, or a mount that creeps.",
    ),
)
SENSOR_SATURATION = Effect(
    id="sensor_saturation",
    equation="accel -> clipped at +-a_max",
    summary="the accelerometer's range is too small",
    acts_on=ActsOn.SENSOR,
    bases=SENSED,
    parameters={"a_max": _A_MAX},
    defaults={"oscillator": {"a_max": joint_sized(_A_MAX)}},
    terms=on(SENSED, Term(READING, saturation, ("a_max",))),
    guesses=lambda scales: grid(a_max=(0.999 * scales.peak,)),
    barely=lambda scales: [{"a_max": 0.98 * scales.peak}],
    words=Words(
        "a sensor at its limit",
        "The accelerometer is cut off at {a_max}.",
        "Set a wider range in the sensor, or make the reversals gentler; what is cut off is lost.",
    ),
)
