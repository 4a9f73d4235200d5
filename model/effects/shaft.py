"""Drives that are not stiff: a shaft that twists behind the gear, an actuator of finite strength before it."""

from __future__ import annotations

import math
from collections.abc import Mapping

from lostmotion.model.base import Operating, Term
from lostmotion.model.effects.base import ActsOn, Effect, on
from lostmotion.model.effects.guesses import MotionScales, Values, grid
from lostmotion.model.effects.words import Words
from lostmotion.model.kernel import Slots, kernel
from lostmotion.model.parameter import Domain, Parameter
from lostmotion.model.signals import (
    COMMAND,
    COMMAND_RATE,
    FORCE,
    GAP,
    GAP_RATE,
    INERTIA,
    OMEGA1,
    OMEGA2,
    THETA1,
    THETA2,
    TORQUE,
)

__all__ = ["FINITE_ACTUATOR", "SHAFT_COMPLIANCE"]

DAMPED = (0.05, 0.1, 0.4)
"""Damping ratios with which a fit of a shaft begins again.  Of 16 fits that began at other stiffnesses and hardly any
damping (eight cases of ``bench.hidden_effects``), a ratio of 0.02 led to the least error in one case, 0.05 in four, 0.1
in five, 0.2 in two and 0.4 in three; one fit was the best one at once."""

# theta_2 stays the joint's output, the far end: bar, sensor, gravity and friction are there.  The near end is the
# effect's own state x = (angle, speed), and meets the contact in theta_2's stead.


@kernel
def near_gap(s: Slots, x: Slots, dx: Slots, p: Slots) -> float:
    """The gear's angle is x0, not theta_2; p: share, k_s, c_s, J2, R2."""
    return p[4] * (x[0] - s[THETA2])


@kernel
def near_gap_rate(s: Slots, x: Slots, dx: Slots, p: Slots) -> float:
    """The gear's speed is x1, not omega_2; p: share, k_s, c_s, J2, R2."""
    return p[4] * (x[1] - s[OMEGA2])


@kernel
def far_inertia(s: Slots, x: Slots, dx: Slots, p: Slots) -> float:
    """Only a share of J2 is behind the shaft; p: share, k_s, c_s, J2, R2."""
    return (p[0] - 1.0) * p[3]


@kernel
def twist(s: Slots, x: Slots, dx: Slots, p: Slots) -> float:
    """The shaft's torque in place of the contact's -F R2; sets the near end's motion; p: share, k_s, c_s, J2, R2."""
    shaft = p[1] * (x[0] - s[THETA2]) + p[2] * (x[1] - s[OMEGA2])
    dx[0] = x[1]
    dx[1] = (-s[FORCE] * p[4] - shaft) / ((1.0 - p[0]) * p[3])
    return s[FORCE] * p[4] + shaft


def _twist_rate(values: Mapping[str, float], operating: Operating) -> float:
    """Twice the torsional frequency [rad/s]."""
    near = (1 - values["share"]) * values["J2"]
    far = values["share"] * values["J2"]
    return max(2 * math.sqrt(values["k_s"] * (1 / near + 1 / far)), values["c_s"] * (1 / near + 1 / far))


# The actuator's state x = (angle, speed) of gear 1 takes the place of theta_1; what theta_1 was is its servo's aim.


@kernel
def servo_angle(s: Slots, x: Slots, dx: Slots, p: Slots) -> float:
    """x0'' = w² (aim - x0) + …; theta_1 becomes x0; p: J1, f1, zeta1, R1."""
    w = 2 * math.pi * p[1]
    dx[0] = x[1]
    dx[1] = w * w * (s[THETA1] - x[0])
    return x[0] - s[THETA1]


@kernel
def servo_rate(s: Slots, x: Slots, dx: Slots, p: Slots) -> float:
    """… + 2 zeta1 w (aim' - x1) + …; omega_1 becomes x1; p: J1, f1, zeta1, R1."""
    dx[1] += 4 * math.pi * p[1] * p[2] * (s[OMEGA1] - x[1])
    return x[1] - s[OMEGA1]


@kernel
def push_back(s: Slots, x: Slots, dx: Slots, p: Slots) -> float:
    """… + F R1/J1, the contact's reaction; nothing is added to the joint; p: J1, f1, zeta1, R1."""
    dx[1] += s[FORCE] * p[3] / p[0]
    return 0.0


def _servo_rate(values: Mapping[str, float], operating: Operating) -> float:
    """Twice the loop's natural frequency, or its damping where that is more [rad/s]."""
    return 2 * math.pi * values["f1"] * max(2.0, 2 * values["zeta1"])


def _stiffness(scales: MotionScales, share: float, frequency_hz: float) -> float:
    """Of a shaft that lets this share of the inertia swing against the rest [N m/rad]."""
    return scales.inertia * share * (1 - share) * (2 * math.pi * frequency_hz) ** 2


def _shafts(scales: MotionScales) -> list[Values]:
    return [
        {"share": share, "k_s": k, "c_s": 0.02 * math.sqrt(k * scales.inertia / 2)}
        for share, frequencies in ((0.5, (35.0, 60.0, 100.0, 160.0)), (0.8, (160.0, 260.0, 420.0)))
        for f in frequencies
        for k in [_stiffness(scales, share, f)]
    ]


def _damped_shafts(values: Mapping[str, float]) -> list[Values]:
    """Larger shares of the critical damping.  A shaft with little damping rings through a segment, and its cost has a
    minimum for each phase in which it may end."""
    critical = 2 * math.sqrt(values["k_s"] * values["J2"] * values["share"] * (1 - values["share"]))
    return [{"c_s": damping * critical} for damping in DAMPED]


_SHAFT = ("share", "k_s", "c_s", "J2", "R2")
SHAFT_COMPLIANCE = Effect(
    id="shaft_compliance",
    equation="share J2 theta_2'' = k_s (x - theta_2) + c_s (x' - theta_2'), (1 - share) J2 x'' = -F R2 - the same",
    summary="a share of J2 is behind a torsion spring; theta_2, bar and sensor ride on that far part",
    acts_on=ActsOn.JOINT,
    bases=("play",),
    parameters={
        "share": Parameter(0.8, "", 0.05, 0.99, False, "guess", "share of J2 behind the shaft", Domain.SHARE),
        "k_s": Parameter(50.0, "N m/rad", 0.1, 1e4, False, "guess: 90 Hz with the gear held", "stiffness",
                         Domain.POSITIVE),
        "c_s": Parameter(2e-3, "N m s/rad", 0.0, 1.0, False, "guess: 1 % of critical", "damping", Domain.NOT_NEGATIVE),
    },
    terms=on(("play",), Term(GAP, near_gap, _SHAFT), Term(GAP_RATE, near_gap_rate, _SHAFT),
             Term(INERTIA, far_inertia, _SHAFT), Term(TORQUE, twist, _SHAFT)),
    states=(THETA2, OMEGA2),
    rate=_twist_rate,
    guesses=_shafts,
    restarts=_damped_shafts,
    barely=lambda scales: [
        {"share": share, "k_s": k, "c_s": 0.05 * math.sqrt(k * scales.inertia)}
        for share in (0.3, 0.7)
        for k in [_stiffness(scales, share, 200.0)]
    ],
    words=Words(
        "a shaft that twists",
        "The shaft behind the gear twists: its stiffness is only {k_s}.",
        "Look for loose screws in the coupling or horn, a cracked hub, or a long thin shaft.",
    ),
)  # fmt: skip
_ACTUATOR = ("J1", "f1", "zeta1", "R1")
FINITE_ACTUATOR = Effect(
    id="finite_actuator",
    equation="J1 (theta_1'' - w1^2 (aim - theta_1) - 2 zeta1 w1 (aim' - theta_1')) = F R1",
    summary="gear 1 has an inertia, is held by a PD servo and pushed back by the contact",
    acts_on=ActsOn.COMMAND,
    bases=("play",),
    parameters={
        "J1": Parameter(1e-3, "kg m^2", 1e-6, 1.0, False, "guess: a rotor seen through its gears", "inertia of gear 1",
                        Domain.POSITIVE),
        "f1": Parameter(30.0, "Hz", 1.0, 500.0, False, "guess", "bandwidth of the servo", Domain.POSITIVE),
        "zeta1": Parameter(0.7, "", 0.0, 5.0, False, "guess", "damping ratio of the servo", Domain.NOT_NEGATIVE),
    },
    terms=on(("play",), Term(THETA1, servo_angle, _ACTUATOR), Term(OMEGA1, servo_rate, _ACTUATOR),
             Term(TORQUE, push_back, _ACTUATOR)),
    states=(COMMAND, COMMAND_RATE),
    rate=_servo_rate,
    guesses=lambda scales: grid(
        f1=(10.0, 18.0, 28.0, 40.0, 60.0), zeta1=(0.7,), J1=(2 * scales.inertia, 6 * scales.inertia)
    ),
    barely=lambda scales: [{"f1": 40.0, "zeta1": 0.7, "J1": 5 * scales.inertia}],
    words=Words(
        "an actuator that gives way",
        "The motor gives way when the gear hits it: it holds its position only up to {f1}.",
        "Look at the servo's position gain and torque limit, and at the supply voltage under load.",
    ),
)  # fmt: skip
