"""Dry friction that does not change sign at once: it is elastic near a reversal, or acts through play.

Both are corrections of a dry friction that is in the model already: after the distance that they need, what is left is
the constant friction.  The state y is how far the motion has come from where the friction was zero; it follows from the
motion of the joint alone, as that of a rate-independent hysteresis does.

``lab explain`` does not try them: a joint whose dry friction is smoother near rest than the model's looks elastic
(docs/decisions/0009-lab-selection.md).  They are added by hand, and fitted.

References: P. R. Dahl, "A solid friction model", TOR-0158(3107-18)-1, Aerospace Corporation (1968); F. Al-Bender,
V. Lampaert, J. Swevers, "The generalized Maxwell-slip model", IEEE Trans. Automatic Control 50 (2005); A. Visintin,
Differential Models of Hysteresis (1994): play and stop operators.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from lostmotion.model.base import Operating, Term
from lostmotion.model.effects.base import ActsOn, Effect, Simpler, omega_0, on
from lostmotion.model.effects.guesses import MotionScales, Values, grid
from lostmotion.model.effects.words import Words
from lostmotion.model.kernel import Slots, kernel
from lostmotion.model.parameter import Domain, Parameter
from lostmotion.model.signals import OMEGA2, TORQUE

__all__ = ["FRICTION_BACKLASH", "PRESLIDING_FRICTION"]

BASES = ("joint",)
SHARES = (0.005, 0.02, 0.08, 0.25)
"""Of the motion's span: distances over which friction builds up, from which a fit begins."""
GAPS = (0.02, 0.06, 0.2)
"""The same of a play."""


@kernel
def presliding(s: Slots, x: Slots, dx: Slots, p: Slots) -> float:
    """-tau_p (z - sign omega), z' = omega (1 - z sign omega)/x_p (Dahl); p: tau_p, x_p, omega_0."""
    omega = s[OMEGA2]
    dx[0] = (omega - abs(omega) * x[0]) / p[1]
    return -p[0] * (x[0] - math.tanh(omega / p[2]))


@kernel
def backlash(s: Slots, x: Slots, dx: Slots, p: Slots) -> float:
    """-tau_p (w - sign omega), w(y): zero for |y| < gap/2, then rising over x_p to one; y' = omega, and zero where
    that would lead beyond |y| = gap/2 + x_p; p: tau_p, x_p, gap, omega_0."""
    omega, half = s[OMEGA2], 0.5 * p[2]
    dx[0] = 0.0 if x[0] * omega > 0.0 and abs(x[0]) >= half + p[1] else omega
    w = math.copysign(min(max((abs(x[0]) - half) / p[1], 0.0), 1.0), x[0])
    return -p[0] * (w - math.tanh(omega / p[3]))


def _distance(values: Mapping[str, float]) -> float:
    return values["x_p"]


def _backlash_distance(values: Mapping[str, float]) -> float:
    """The rise, or a quarter of the way: a step leads beyond its end by half its length in the mean."""
    return min(values["x_p"], (values["x_p"] + 0.5 * values["gap"]) / 4)


def _rate(values: Mapping[str, float], operating: Operating) -> float:
    """Of the joint that sticks on its elastic friction, of the smoothed sign, or of the distance at the largest speed,
    as after half a turn with the largest torque [rad/s]."""
    sticking = 2 * math.sqrt(values["tau_p"] / values["x_p"] / operating.inertia)
    sign = values["tau_p"] / values["omega_0"] / operating.inertia
    speed = math.sqrt(2 * math.pi * (operating.watched or 0.0) / operating.inertia)
    return max(sticking, 0.5 * sign, speed / values["x_p"])


def _guesses(scales: MotionScales) -> list[Values]:
    return grid(tau_p=[0.05 * scales.torque], x_p=[scales.span * share for share in SHARES])


def _backlash_guesses(scales: MotionScales) -> list[Values]:
    distances = {"x_p": [scales.span * share for share in SHARES[1:3]], "gap": [scales.span * share for share in GAPS]}
    return grid(tau_p=[0.05 * scales.torque], **distances)


_TAU_P = Parameter(1e-5, "N m", 0.0, 1e9, False, "guess", "dry friction that comes late", Domain.NOT_NEGATIVE)
_X_P = Parameter(1e-2, "rad", 1e-9, 1e6, False, "guess", "distance over which it builds up", Domain.POSITIVE)
_GAP = Parameter(1e-2, "rad", 0.0, 1e6, False, "guess", "play before it is felt", Domain.NOT_NEGATIVE)
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
    amplitudes=("tau_p",),
    guesses=_guesses,
    words=Words(
        "elastic presliding",
        "After a reversal friction builds up over {x_p}: {tau_p} of it is elastic at first.",
        "Usually no fault: teeth, seals, belts and harmonic drives give before they slide. If the distance grows, look "
        "for a loose coupling or a worn bearing.",
    ),
)
FRICTION_BACKLASH = Effect(
    id="friction_backlash",
    equation="-tau_p (w - sign(omega)); w is zero over the play gap after a reversal, then rises over x_p to one",
    summary="dry friction that acts through play: a correction of Coulomb friction",
    acts_on=ActsOn.JOINT,
    bases=BASES,
    parameters={"tau_p": _TAU_P, "x_p": _X_P, "gap": _GAP, "omega_0": omega_0(2e-3)},
    terms=on(BASES, Term(TORQUE, backlash, ("tau_p", "x_p", "gap", "omega_0"))),
    states=(None,),
    distance=_backlash_distance,
    is_searched=False,
    rate=_rate,
    amplitudes=("tau_p",),
    guesses=_backlash_guesses,
    simpler=Simpler("presliding_friction", {"tau_p": ("tau_p",), "x_p": ("x_p",)}),
    words=Words(
        "friction behind play",
        "There is play between the drive and what rubs: after a reversal {gap} pass before {tau_p} of friction are "
        "felt.",
        "Hold the output and turn the drive to and fro: look for worn teeth, a loose key, coupling or set screw.",
    ),
)
