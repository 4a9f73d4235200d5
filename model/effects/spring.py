"""A spring on the joint: a gas spring beside a damper, a wire that twists, a flexure."""

from __future__ import annotations

import math
from collections.abc import Mapping

from lostmotion.model.base import Operating, Term
from lostmotion.model.effects.base import JOINT_MOST, SHAFT_TURNS, ActsOn, Effect, on
from lostmotion.model.effects.guesses import grid
from lostmotion.model.effects.words import Words
from lostmotion.model.kernel import Slots, kernel
from lostmotion.model.parameter import Domain, Parameter
from lostmotion.model.signals import THETA2, TORQUE

__all__ = ["SPRING_TORQUE"]

BASES = ("joint",)


@kernel
def spring_torque(s: Slots, x: Slots, dx: Slots, p: Slots) -> float:
    """-k_s theta_2; p: k_s.  Where it is at rest is a part of the constant torque."""
    return -p[0] * s[THETA2]


def _rate(values: Mapping[str, float], operating: Operating) -> float:
    """Four times the frequency of the joint on its spring, whose swing lasts [rad/s]."""
    return 4 * math.sqrt(values["k_s"] / operating.inertia)


SPRING_TORQUE = Effect(
    id="spring_torque",
    equation="-k_s theta_2",
    summary="a spring that pulls the joint back; where it is at rest is a part of the constant torque",
    acts_on=ActsOn.JOINT,
    bases=BASES,
    parameters={
        "k_s": Parameter(1e-3, "N m/rad", 0.0, JOINT_MOST, False, "guess", "stiffness", Domain.NOT_NEGATIVE),
    },
    terms=on(BASES, Term(TORQUE, spring_torque, ("k_s",))),
    rate=_rate,
    amplitudes=("k_s",),
    guesses=lambda scales: grid(k_s=[scales.torque / scales.span * share for share in (0.02, 0.1)]),
    likelier="gravity_torque",
    odds=100.0,
    most_turns=SHAFT_TURNS,
    rests_by="bias",
    words=Words(
        "a spring",
        "A spring pulls the joint back: its stiffness is {k_s}.",
        "Usually no fault: a gas spring, a cable, a wire that twists, or an unknown controller; else look "
        "for what the joint pushes against.",
    ),
)
