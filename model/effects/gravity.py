"""Gravity on the joint: the torque of an arm that is not balanced, and one that is the same at all angles."""

from __future__ import annotations

import math
from collections.abc import Mapping

from lostmotion.model.base import Operating, Term
from lostmotion.model.effects.base import ActsOn, Effect, joint_sized, on, servo_sized
from lostmotion.model.effects.guesses import PHASES, grid
from lostmotion.model.effects.words import Words
from lostmotion.model.elementary import sine
from lostmotion.model.kernel import Slots, kernel
from lostmotion.model.parameter import Domain, Parameter
from lostmotion.model.signals import THETA2, TORQUE

__all__ = ["CONSTANT_TORQUE", "GRAVITY_TORQUE"]

JOINTS = ("play", "joint", "servo")
WITHOUT = ("servo",)
"""The bases that have no constant torque of their own; of gears it only shows how the teeth rest."""


@kernel
def gravity_torque(s: Slots, x: Slots, dx: Slots, p: Slots) -> float:
    """-tau_g sin(theta_2 + phi); p: tau_g, phi."""
    return -p[0] * sine(s[THETA2] + p[1])


@kernel
def constant_torque(s: Slots, x: Slots, dx: Slots, p: Slots) -> float:
    """tau_0; p: tau_0."""
    return p[0]


def _rate(values: Mapping[str, float], operating: Operating) -> float:
    """Four times the pendulum's frequency, whose swing lasts [rad/s]."""
    return 4 * math.sqrt(values["tau_g"] / operating.inertia)


_TAU_G = Parameter(2e-3, "N m", 0.0, 1.0, False, "guess: 2 g at 0.1 m", "weight times its arm", Domain.NOT_NEGATIVE)
GRAVITY_TORQUE = Effect(
    id="gravity_torque",
    equation="-tau_g sin(theta_2 + phi)",
    summary="weight of an unbalanced arm; phi is the angle from hanging down at theta_2 = 0",
    acts_on=ActsOn.JOINT,
    bases=JOINTS,
    parameters={
        "tau_g": _TAU_G,
        "phi": Parameter(0.0, "rad", -math.pi, math.pi, False, "guess: hanging", "angle at rest"),
    },
    terms=on(JOINTS, Term(TORQUE, gravity_torque, ("tau_g", "phi"))),
    rate=_rate,
    defaults={"joint": {"tau_g": joint_sized(_TAU_G)}, "servo": {"tau_g": servo_sized(_TAU_G)}},
    amplitudes=("tau_g",),
    guesses=lambda scales: grid(tau_g=[scales.torque * share for share in (0.02, 0.1)], phi=PHASES),
    rests_by="phi",
    words=Words(
        "the weight of the arm",
        "The arm is out of balance: its weight turns the joint with up to {tau_g}.",
        "Usually no fault: a tool or load that the model does not contain; else a spring or "
        "counterweight has lost force.",
    ),
)
CONSTANT_TORQUE = Effect(
    id="constant_torque",
    equation="tau_0",
    summary="the same torque at all angles; of a servo also the difference between the zeros of goal and angle",
    acts_on=ActsOn.JOINT,
    bases=WITHOUT,
    parameters={"tau_0": Parameter(0.05, "N m", -1e3, 1e3, False, "guess", "constant torque")},
    terms=on(WITHOUT, Term(TORQUE, constant_torque, ("tau_0",))),
    amplitudes=("tau_0",),
    guesses=lambda scales: grid(tau_0=[scales.torque * share for share in (-0.1, 0.1)]),
    words=Words(
        "a constant torque",
        "A constant torque of {tau_0} acts on the joint, or the zeros of goal and angle are not the same.",
        "Usually no fault: the zeros of goal and angle differ, or a load, a spring or a counterweight pulls.",
    ),
)
