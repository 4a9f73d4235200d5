"""Dry friction that does not change sign at once: near a reversal it is elastic.

It is a correction of a dry friction that is in the model already: some distance after a reversal what is left is the
constant friction.  Its state follows from the motion of the joint alone, as that of a rate-independent hysteresis does.

``lab explain`` does not try it: a joint whose dry friction is smoother near rest than the model's looks elastic
(docs/decisions/0009-lab-selection.md).  It is added by hand, and fitted.

References: P. R. Dahl, "A solid friction model", TOR-0158(3107-18)-1, Aerospace Corporation (1968); F. Al-Bender,
V. Lampaert, J. Swevers, "The generalized Maxwell-slip model", IEEE Trans. Automatic Control 50 (2005).
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from lostmotion.model.base import Operating, Term
from lostmotion.model.effects.base import ActsOn, Effect, omega_0, on, within_omega_0
from lostmotion.model.effects.words import Words
from lostmotion.model.elementary import tanh
from lostmotion.model.kernel import Slots, kernel
from lostmotion.model.parameter import Domain, Parameter
from lostmotion.model.signals import OMEGA2, TORQUE

__all__ = ["PRESLIDING_FRICTION"]

BASES = ("joint",)


@kernel
def presliding(s: Slots, x: Slots, dx: Slots, p: Slots) -> float:
    """-tau_p (z - sign omega), z' = omega (1 - z sign omega)/x_p (Dahl); p: tau_p, x_p, omega_0."""
    omega = s[OMEGA2]
    dx[0] = (omega - abs(omega) * x[0]) / p[1]
    return -p[0] * (x[0] - tanh(omega / p[2]))


def _distance(values: Mapping[str, float]) -> float:
    return values["x_p"]


def _rate(values: Mapping[str, float], operating: Operating) -> float:
    """Of the joint that sticks on its elastic friction, or of the distance at the largest speed, as after half a turn
    with the largest torque [rad/s]."""
    sticking = 2 * math.sqrt(values["tau_p"] / values["x_p"] / operating.inertia)
    speed = math.sqrt(2 * math.pi * (operating.watched or 0.0) / operating.inertia)
    return max(sticking, speed / values["x_p"])


_TAU_P = Parameter(1e-5, "N m", 0.0, 1e9, False, "guess", "dry friction that comes late", Domain.NOT_NEGATIVE)
_X_P = Parameter(1e-2, "rad", 1e-9, 1e6, False, "guess", "distance over which it builds up", Domain.POSITIVE)
PRESLIDING_FRICTION = Effect(
    id="presliding_friction",
    equation="-tau_p (z - sign(omega)), z' = omega (1 - z sign(omega))/x_p",
    summary="dry friction that builds up over a distance after each reversal (Dahl): a correction of Coulomb friction",
    acts_on=ActsOn.JOINT,
    bases=BASES,
    parameters={"tau_p": _TAU_P, "x_p": _X_P, "omega_0": omega_0(2e-3)},
    terms=on(BASES, Term(TORQUE, presliding, ("tau_p", "x_p", "omega_0"))),
    states=(None,),
    distance=_distance,
    is_searched=False,
    rate=_rate,
    sign_width=within_omega_0,
    amplitudes=("tau_p",),
    words=Words(
        "elastic presliding",
        "After a reversal friction builds up over {x_p}: {tau_p} of it is elastic at first.",
        "Usually no fault: teeth, seals, belts and harmonic drives give before they slide. If the distance grows, look "
        "for a loose coupling or a worn bearing.",
    ),
)
