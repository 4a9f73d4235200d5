"""The two spur gears with play, eqs. 1-5: their terms, and how fast their contact can be.  No oscillator here.

The sign of the play is the paper's: delta_d = p2 - p1 is positive when the driven tooth is ahead, and F_cnt then holds
it back.  Both gears turn the same way for a positive angle.  The contact only takes energy away: eq. 1's elastic part
has a potential, and its viscous part dissipates alpha delta_v² (2 delta_d/d)^(n+1) >= 0, n + 1 being even.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from lostmotion.model.base import Fusion, Operating, Term
from lostmotion.model.kernel import Slots, kernel, whole_power
from lostmotion.model.parameter import Domain, Parameter
from lostmotion.model.signals import ALPHA2, FORCE, GAP, GAP_RATE, INERTIA, OMEGA1, OMEGA2, THETA1, THETA2, TORQUE

__all__ = ["FUSION", "PARAMETERS", "TERMS", "acceleration", "contact_rate"]

PARAMETERS: Mapping[str, Parameter] = {
    "R1": Parameter(0.010, "m", 1e-3, 0.1, True, "guess: an AX-12A's output gear", "radius of gear 1", Domain.POSITIVE),
    "R2": Parameter(0.010, "m", 1e-3, 0.1, True, "guess: an AX-12A's output gear", "radius of gear 2", Domain.POSITIVE),
    "J2": Parameter(
        2e-4, "kg m^2", 1e-6, 1.0, True, "guess: 20 g at 0.1 m", "inertia behind gear 2", Domain.POSITIVE
    ),
    "beta": Parameter(
        20.0, "N", 1e-2, 1e4, True, "convention: d/2 is where the force is beta", "contact force at the gap d/2",
        Domain.POSITIVE,
    ),
    "alpha": Parameter(
        4000.0, "N s/m", 1.0, 1e6, False, "guess: from about 3000 the motion is predictable", "contact damping",
        Domain.NOT_NEGATIVE,
    ),
    "n": Parameter(11.0, "", 1, 101, True, "guess: the paper says a large odd number", "contact exponent", Domain.ODD),
    "d": Parameter(8e-5, "m", 1e-6, 1e-3, False, "guess: 0.46 deg on 10 mm, a worn AX-12A", "play", Domain.POSITIVE),
}  # fmt: skip


@kernel
def gap(s: Slots, x: Slots, dx: Slots, p: Slots) -> float:
    """delta_d = theta_2 R2 - theta_1 R1 (eqs. 3 and 4)."""
    return p[1] * s[THETA2] - p[0] * s[THETA1]


@kernel
def gap_rate(s: Slots, x: Slots, dx: Slots, p: Slots) -> float:
    """delta_v = p2' - p1' (eq. 5)."""
    return p[1] * s[OMEGA2] - p[0] * s[OMEGA1]


@kernel
def contact(s: Slots, x: Slots, dx: Slots, p: Slots) -> float:
    """F_cnt = beta X^n + alpha delta_v X^(n+1), X = delta_d/(d/2) (eq. 1); p: beta, alpha, n, d."""
    closed = s[GAP] * (2.0 / p[3])
    return whole_power(closed, p[2]) * (p[0] + p[1] * s[GAP_RATE] * closed)


@kernel
def contact_torque(s: Slots, x: Slots, dx: Slots, p: Slots) -> float:
    """-F_cnt R2 (eq. 2)."""
    return -p[0] * s[FORCE]


@kernel
def acceleration(s: Slots, x: Slots, dx: Slots, p: Slots) -> float:
    """theta_2'' = torque / inertia (eq. 2)."""
    return s[TORQUE] * (1.0 / s[INERTIA])


@kernel
def fused_contact(s: Slots, x: Slots, dx: Slots, p: Slots) -> float:
    """gap, gap_rate, contact and contact_torque in one call; p: R1, R2, beta, alpha, n, d."""
    s[GAP] = p[1] * s[THETA2] - p[0] * s[THETA1]
    s[GAP_RATE] = p[1] * s[OMEGA2] - p[0] * s[OMEGA1]
    closed = s[GAP] * (2.0 / p[5])
    s[FORCE] = whole_power(closed, p[4]) * (p[2] + p[3] * s[GAP_RATE] * closed)
    return -p[1] * s[FORCE]


TERMS = (
    Term(GAP, gap, ("R1", "R2")),
    Term(GAP_RATE, gap_rate, ("R1", "R2")),
    Term(FORCE, contact, ("beta", "alpha", "n", "d")),
    Term(TORQUE, contact_torque, ("R2",)),
    Term(ALPHA2, acceleration),
)
FUSION = Fusion((GAP, GAP_RATE, FORCE, TORQUE), fused_contact, ("R1", "R2", "beta", "alpha", "n", "d"))


def contact_rate(values: Mapping[str, float], operating: Operating) -> float:
    """Fastest rate of the contact [rad/s] at its operating force.

    With the elastic law alone and X = (F/beta)^(1/n): stiffness n beta X^(n-1)/(d/2) and damping alpha X^(n+1) on the
    mass J2/R2².  Before a first run the force is guessed: what carries the load at the largest acceleration, or the
    impact after the load has fallen through the gap, whichever is more.
    """
    n, half, beta = values["n"], values["d"] / 2, values["beta"]
    mass = values["J2"] / values["R2"] ** 2
    force = operating.watched
    if force is None:
        pull = operating.acceleration * values["R1"]
        fall = min(math.sqrt(8 * pull * half), 2 * operating.speed * values["R1"])
        impact = ((n + 1) * mass * fall**2 / (2 * beta * half)) ** (n / (n + 1))
        force = max(mass * pull, beta * impact)
    closed = max((force / beta) ** (1 / n), 1e-3)
    stiffness = n * beta * closed ** (n - 1) / half
    return max(math.sqrt(stiffness / mass), float(values["alpha"] * closed ** (n + 1) / mass))
