"""Friction in the joint: viscous, Coulomb (of an oscillator too), Stribeck, and growing with the load.

sign(omega) is smoothed to tanh(omega/omega_0): a fixed-step solver cannot resolve a jump, and below omega_0 the joint
creeps instead of sticking.  omega_0 is a parameter, fixed where an accelerometer does not feel it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from lostmotion.model.base import Operating, Term
from lostmotion.model.effects.base import (
    JOINT_MOST,
    ActsOn,
    Effect,
    Simpler,
    joint_sized,
    omega_0,
    on,
    servo_sized,
    within_omega_0,
)
from lostmotion.model.effects.guesses import SMALL, grid
from lostmotion.model.effects.words import Words
from lostmotion.model.elementary import exponential, tanh
from lostmotion.model.kernel import Slots, kernel
from lostmotion.model.parameter import Domain, Parameter
from lostmotion.model.signals import BAR_FORCE, FORCE, OMEGA2, Q_RATE, TORQUE

__all__ = ["COULOMB", "LOAD_DEPENDENT", "STRIBECK", "VISCOUS"]

JOINTS = ("play", "joint", "servo")
GUESS = "guess: about 5 % of the torque that moves the joint"
MOST_LOST = 0.8
"""Of the transmitted torque: worm gears, the least efficient in use, pass on a fifth or more (makers' catalogues).  A
law that takes more only rescales all other torques."""


@kernel
def viscous(s: Slots, x: Slots, dx: Slots, p: Slots) -> float:
    """-b_v omega; p: b_v."""
    return -p[0] * s[OMEGA2]


@kernel
def coulomb(s: Slots, x: Slots, dx: Slots, p: Slots) -> float:
    """-tau_c sign(omega); p: tau_c, omega_0."""
    return -p[0] * tanh(s[OMEGA2] / p[1])


@kernel
def coulomb_on_oscillator(s: Slots, x: Slots, dx: Slots, p: Slots) -> float:
    """-tau_c sign(q'); p: tau_c, omega_0."""
    return -p[0] * tanh(s[Q_RATE] / p[1])


@kernel
def stribeck(s: Slots, x: Slots, dx: Slots, p: Slots) -> float:
    """-(tau_c + (tau_s - tau_c) exp(-(omega/omega_s)²)) sign(omega); p: tau_c, tau_s, omega_s, omega_0."""
    fall = exponential(-((s[OMEGA2] / p[2]) ** 2))
    return -(p[0] + (p[1] - p[0]) * fall) * tanh(s[OMEGA2] / p[3])


@kernel
def load_dependent(s: Slots, x: Slots, dx: Slots, p: Slots) -> float:
    """-mu |F| R2 sign(omega); p: mu, omega_0, R2."""
    return -p[0] * abs(s[FORCE]) * p[2] * tanh(s[OMEGA2] / p[1])


@kernel
def torque_dependent(s: Slots, x: Slots, dx: Slots, p: Slots) -> float:
    """-mu |transmitted torque| sign(omega); p: mu, omega_0."""
    return -p[0] * abs(s[FORCE]) * tanh(s[OMEGA2] / p[1])


def _stribeck_rate(values: Mapping[str, float], operating: Operating) -> float:
    """Largest slope of the fall of the friction over the inertia [rad/s]; of exp(-x²) it is 0.86."""
    return 0.86 * abs(values["tau_s"] - values["tau_c"]) / values["omega_s"] / operating.inertia


def _viscous_rate(values: Mapping[str, float], operating: Operating) -> float:
    return abs(values["b_v"]) / operating.inertia


_B_V = Parameter(4e-4, "N m s/rad", 0.0, 1e-1, False, GUESS, "viscous friction", Domain.NOT_NEGATIVE)
_TAU_C = Parameter(3e-4, "N m", 0.0, 1e-1, False, GUESS, "Coulomb friction", Domain.NOT_NEGATIVE)
_TAU_S = Parameter(5e-4, "N m", 0.0, 1e-1, False, GUESS, "static friction", Domain.NOT_NEGATIVE)
_OMEGA_S = Parameter(0.1, "rad/s", 1e-3, 10.0, False, "guess", "Stribeck speed", Domain.POSITIVE)
_FELT = omega_0(5e-3, 1e-3, 5e-2, fixed=False)  # gears that pass through rest show in the bar's ring how smoothly
_SLIDING = {
    "tau_c": Parameter(0.05, "N", 0.0, JOINT_MOST, False, "guess: 5 % of k q at 0.4 mm", "Coulomb friction",
                       Domain.NOT_NEGATIVE),
    "omega_0": replace(omega_0(1e-3, 1e-9, 1e3), unit="m/s"),
}  # fmt: skip
_SLOW = {base: {"omega_0": omega_0(2e-3)} for base in ("joint", "servo")}

VISCOUS = Effect(
    id="viscous_friction",
    equation="-b_v omega",
    summary="friction in proportion to speed: grease, back-EMF",
    acts_on=ActsOn.JOINT,
    bases=JOINTS,
    parameters={"b_v": _B_V},
    terms=on(JOINTS, Term(TORQUE, viscous, ("b_v",))),
    rate=_viscous_rate,
    defaults={"joint": {"b_v": joint_sized(_B_V)}, "servo": {"b_v": servo_sized(_B_V)}},
    amplitudes=("b_v",),
    speed_power=1,
    guesses=lambda scales: grid(b_v=[scales.torque / scales.speed * share for share in SMALL]),
    words=Words(
        "viscous friction",
        "The joint drags in proportion to its speed: viscous friction of {b_v}.",
        "Look at the grease: too much, too thick, old, or cold. A motor that is held by shorted leads drags so too.",
    ),
)
COULOMB = Effect(
    id="coulomb_friction",
    equation="-tau_c sign(omega)",
    summary="dry friction of constant size; of an oscillator a force against its speed",
    acts_on=ActsOn.JOINT,
    bases=(*JOINTS, "oscillator"),
    parameters={"tau_c": _TAU_C, "omega_0": _FELT},
    terms={
        **on(JOINTS, Term(TORQUE, coulomb, ("tau_c", "omega_0"))),
        "oscillator": (Term(BAR_FORCE, coulomb_on_oscillator, ("tau_c", "omega_0")),),
    },
    sign_width=within_omega_0,
    defaults={
        "joint": {"tau_c": joint_sized(_TAU_C), **_SLOW["joint"]},
        "servo": {"tau_c": servo_sized(_TAU_C), **_SLOW["servo"]},
        "oscillator": _SLIDING,
    },
    amplitudes=("tau_c",),
    speed_power=0,
    guesses=lambda scales: grid(tau_c=[scales.torque * share for share in SMALL]),
    words=Words(
        "Coulomb friction",
        "Something rubs: Coulomb friction of {tau_c}.",
        "Move it by hand without power: look for a dry or dirty bearing, one that is pressed too hard, a seal "
        "or a cable that drags.",
    ),
)
STRIBECK = Effect(
    id="stribeck_friction",
    equation="-(tau_c + (tau_s - tau_c) exp(-(omega/omega_s)^2)) sign(omega)",
    summary="dry friction that is larger near rest: the whole law, Coulomb included",
    acts_on=ActsOn.JOINT,
    bases=JOINTS,
    parameters={"tau_c": _TAU_C, "tau_s": _TAU_S, "omega_s": _OMEGA_S, "omega_0": _FELT},
    terms=on(JOINTS, Term(TORQUE, stribeck, ("tau_c", "tau_s", "omega_s", "omega_0"))),
    rate=_stribeck_rate,
    sign_width=within_omega_0,
    defaults={
        "joint": {"tau_c": joint_sized(_TAU_C), "tau_s": joint_sized(_TAU_S), **_SLOW["joint"]},
        "servo": {"tau_c": servo_sized(_TAU_C), "tau_s": servo_sized(_TAU_S), **_SLOW["servo"]},
    },
    is_apt=lambda values: values["tau_s"] >= values["tau_c"],
    amplitudes=("tau_c", "tau_s"),
    guesses=lambda scales: [
        {"tau_c": scales.torque * share, "tau_s": scales.torque * share * 2.5, "omega_s": scales.speed * speed}
        for share, speed in ((0.02, 0.3), (0.06, 0.3), (0.15, 0.3), (0.06, 0.8))
    ],
    simpler=Simpler("coulomb_friction", {"tau_c": ("tau_c", "tau_s")}),
    words=Words(
        "Stribeck friction",
        "The joint sticks before it slides: near rest its friction is {tau_s}; in motion it is {tau_c}.",
        "Look for grease that was pressed out of the bearing or has hardened, and for a seal that sticks; move the "
        "joint through its whole range and grease it anew.",
        lambda values: values["tau_s"] >= values["tau_c"],
        "The joint slides more easily near rest: there its friction is {tau_s}; in motion it is {tau_c}.",
    ),
)
LOAD_DEPENDENT = Effect(
    id="load_dependent_friction",
    equation="-mu |F| R2 sign(omega); servo, joint: -mu |transmitted torque| sign(omega)",
    summary="dry friction that grows with what the gear transmits",
    acts_on=ActsOn.JOINT,
    bases=JOINTS,
    parameters={
        "mu": Parameter(
            0.05, "", 0.0, 1.0, False, "guess: lubricated gears", "friction coefficient", Domain.NOT_NEGATIVE
        ),
        "omega_0": _FELT,
    },
    terms={
        "play": (Term(TORQUE, load_dependent, ("mu", "omega_0", "R2")),),
        **on(("joint", "servo"), Term(TORQUE, torque_dependent, ("mu", "omega_0"))),
    },
    sign_width=within_omega_0,
    defaults=_SLOW,
    is_apt=lambda values: values["mu"] <= MOST_LOST,
    amplitudes=("mu",),
    guesses=lambda scales: grid(mu=(0.01, 0.05, 0.15)),
    words=Words(
        "friction that grows with load",
        "The gear rubs the more, the more it carries: its coefficient of friction is {mu}.",
        "Look at the flanks of the teeth: dry, rough or worn; at a shaft out of line, and at bearings under side load.",
    ),
)
