"""Dry friction that does not change sign at once: near a reversal it is elastic, or acts only behind a play.

Their states follow from the motion of the joint alone, as those of a rate-independent hysteresis do.

The elastic one is a correction of a dry friction that is in the model already: some distance after a reversal what is
left is the constant friction.  ``lab explain`` does not try it: a joint whose dry friction is smoother near rest than
the model's looks elastic (docs/decisions/0009-lab-selection.md).  It is added by hand, and fitted.

References: P. R. Dahl, "A solid friction model", TOR-0158(3107-18)-1, Aerospace Corporation (1968); F. Al-Bender,
V. Lampaert, J. Swevers, "The generalized Maxwell-slip model", IEEE Trans. Automatic Control 50 (2005); the play
operator: M. Brokate, J. Sprekels, "Hysteresis and Phase Transitions", Springer (1996), section 2.2.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from functools import partial

import numpy as np
from numba import njit

from lostmotion.model.base import Operating, Term
from lostmotion.model.effects.base import ActsOn, Effect, omega_0, on, within_omega_0
from lostmotion.model.effects.guesses import MotionScales, Values, grid
from lostmotion.model.effects.words import Words
from lostmotion.model.elementary import tanh
from lostmotion.model.kernel import OPTIONS, Slots, compiled, kernel
from lostmotion.model.motion import FloatArray
from lostmotion.model.parameter import Domain, Parameter
from lostmotion.model.signals import OMEGA2, TORQUE

__all__ = ["FRICTION_BEHIND_PLAY", "PRESLIDING_FRICTION"]

BASES = ("joint",)


@kernel
def presliding(s: Slots, x: Slots, dx: Slots, p: Slots) -> float:
    """-tau_p (z - sign omega), z' = omega (1 - z sign omega)/x_p (Dahl); p: tau_p, x_p, omega_0."""
    omega = s[OMEGA2]
    dx[0] = (omega - abs(omega) * x[0]) / p[1]
    return -p[0] * (x[0] - tanh(omega / p[2]))


@kernel
def behind_play(s: Slots, x: Slots, dx: Slots, p: Slots) -> float:
    """-tau_p z sign(y), z = max(|y| - e/2, 0)/(c e); y' = omega, less by z where it leads on; p: tau_p, e, c.

    An end of y at z = 1 would depend on the step of the solver.
    """
    omega, y = s[OMEGA2], x[0]
    z = min(max((abs(y) - p[1] / 2) / (p[2] * p[1]), 0.0), 1.0)
    dx[0] = omega * (1 - z) if y * omega > 0 else omega
    return -p[0] * z if y > 0 else p[0] * z


def _dahl(position: FloatArray, x_p: float) -> FloatArray:
    """z (N,) of ``presliding``: z = s + (z_0 - s) exp(-q/x_p) after a distance q in the direction s."""
    z, found = 0.0, np.zeros(position.size)
    for i in range(1, position.size):
        way = position[i] - position[i - 1]
        sign = 1.0 if way > 0 else -1.0
        z = sign + (z - sign) * math.exp(-abs(way) / x_p)
        found[i] = z
    return found


def _play(position: FloatArray, e: float, contact: float) -> FloatArray:
    """y (N,) of ``behind_play``: free up to e/2, from there e/2 + c e (1 - (1 - z_0) exp(-q/(c e))) after a distance q;
    contact: c e."""
    y, found = 0.0, np.zeros(position.size)
    for i in range(1, position.size):
        way = position[i] - position[i - 1]
        sign = 1.0 if way > 0 else -1.0
        y, left = sign * y, abs(way)
        free = min(max(e / 2 - y, 0.0), left)
        y, left = y + free, left - free
        if left > 0:
            y = e / 2 + contact + (y - e / 2 - contact) * math.exp(-left / contact)
        y *= sign
        found[i] = y
    return found


_presliding_along = compiled(partial(njit, nogil=True, **OPTIONS), _dahl)
_behind_play_along = compiled(partial(njit, nogil=True, **OPTIONS), _play)


def _contact_rate(values: Mapping[str, float], operating: Operating) -> float:
    """Of the joint on its contact, or of the contact at the largest speed, as after half a turn with the largest torque
    [rad/s]."""
    sticking = 2 * math.sqrt(values["tau_p"] / _contact(values) / operating.inertia)
    speed = math.sqrt(2 * math.pi * (operating.watched or 0.0) / operating.inertia)
    return max(sticking, speed / _contact(values))


def _contact(values: Mapping[str, float]) -> float:
    return values["c"] * values["e"]


def _plays(scales: MotionScales) -> list[Values]:
    """Plays of 2 to 50 % of the motion, with a contact of 0.15 to 0.5 as much."""
    plays = [share * scales.span for share in (0.02, 0.05, 0.1, 0.2, 0.35, 0.5)]
    return grid(tau_p=(0.2 * scales.torque,), e=plays, c=(0.5, 0.15))


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
    along=lambda position, values: _presliding_along(position, values["x_p"]),
    is_searched=False,
    guesses=lambda scales: grid(tau_p=(0.2 * scales.torque,), x_p=[x * scales.span for x in (0.005, 0.02, 0.08, 0.2)]),
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
_E = Parameter(1e-2, "rad", 1e-9, 1e6, False, "guess", "play between the joint and what rubs", Domain.POSITIVE)
_C = Parameter(0.3, "", 0.05, 2.0, False, "guess", "friction builds up over this part of it", Domain.POSITIVE)
FRICTION_BEHIND_PLAY = Effect(
    id="friction_behind_play",
    equation="-tau_p z sign(y), z = max(|y| - e/2, 0)/(c e), y' = omega, or omega (1 - z) where |y| grows",
    summary="dry friction that acts only once the joint has crossed a play after each reversal",
    acts_on=ActsOn.JOINT,
    bases=BASES,
    parameters={"tau_p": replace(_TAU_P, meaning="dry friction behind the play"), "e": _E, "c": _C},
    terms=on(BASES, Term(TORQUE, behind_play, ("tau_p", "e", "c"))),
    states=(None,),
    along=lambda position, values: _behind_play_along(position, values["e"], _contact(values)),
    rate=_contact_rate,
    is_apt=lambda values: values["c"] < 0.95 * _C.high,
    rivals=("viscous_friction", "coulomb_friction", "presliding_friction"),
    amplitudes=("tau_p",),
    likelier="coulomb_friction",
    odds=100.0,
    guesses=_plays,
    words=Words(
        "friction behind a play",
        "After each reversal the joint moves freely by {e}, before something rubs with {tau_p}.",
        "Look for play between the sensor and what rubs: worn teeth, a loose key or coupling, a slack belt or tendon.",
    ),
)
