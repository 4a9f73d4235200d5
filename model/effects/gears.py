"""What real gears add: eccentricity, flanks that differ, a torque that ripples with the angle."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

from lostmotion.model.base import Operating, Term
from lostmotion.model.effects.base import ActsOn, Effect, joint_sized, on, servo_sized
from lostmotion.model.effects.guesses import PHASES, grid, turns
from lostmotion.model.effects.words import Words
from lostmotion.model.elementary import cosine, sine
from lostmotion.model.kernel import Slots, kernel, whole_power
from lostmotion.model.parameter import Domain, Parameter
from lostmotion.model.signals import FORCE, GAP, GAP_RATE, OMEGA1, THETA1, THETA2, TORQUE

__all__ = ["CONTACT_ASYMMETRY", "GEAR_ECCENTRICITY", "TORQUE_RIPPLE"]

JOINTS = ("joint", "servo")
MOST_TEETH, MOST_RIPPLES = 60, 300
"""Periods a turn, at most: of what turns with a gear or a servo's output, whose motion is simulated for each, and of a
torque that was measured.  A motor's cogging has as many as the least common multiple of its slots and poles (36 and 42:
252), a strain wave gear of 100 to 1 has 200; what a motion is too fast for is not tried.  With 60 a motor that cogs 72
times a turn had one of 18, with a fifth of the amplitude."""
_PHI = Parameter(0.0, "rad", -math.pi, math.pi, False, "guess", "phase")


@kernel
def eccentric_gap(s: Slots, x: Slots, dx: Slots, p: Slots) -> float:
    """e sin(N theta_1 + phi); p: e, N, phi."""
    return p[0] * sine(p[1] * s[THETA1] + p[2])


@kernel
def eccentric_rate(s: Slots, x: Slots, dx: Slots, p: Slots) -> float:
    """Its derivative, e N omega_1 cos(N theta_1 + phi); p: e, N, phi."""
    return p[0] * p[1] * s[OMEGA1] * cosine(p[1] * s[THETA1] + p[2])


@kernel
def asymmetric(s: Slots, x: Slots, dx: Slots, p: Slots) -> float:
    """(ratio - 1) beta X^n on the flank X > 0; p: ratio, beta, n, d."""
    closed = 2.0 * s[GAP] / p[3]
    return (p[0] - 1.0) * p[1] * whole_power(closed, p[2]) if closed > 0 else 0.0


@kernel
def ripple(s: Slots, x: Slots, dx: Slots, p: Slots) -> float:
    """tau_r sin(N theta_2 + phi); p: tau_r, N, phi."""
    return p[0] * sine(p[1] * s[THETA2] + p[2])


def _ripple_rate(values: Mapping[str, float], operating: Operating) -> float:
    return 4 * math.sqrt(abs(values["tau_r"]) * values["N"] / operating.inertia)


GEAR_ECCENTRICITY = Effect(
    id="gear_eccentricity",
    equation="delta_d += e sin(N theta_1 + phi)",
    summary="gear 1 runs out of true, N times a turn",
    acts_on=ActsOn.CONTACT,
    bases=("play",),
    parameters={
        "e": Parameter(1e-5, "m", -1e-3, 1e-3, False, "guess: an eighth of the play", "amplitude"),
        "N": Parameter(12.0, "", 1, MOST_TEETH, True, "guess", "periods a turn of gear 1", Domain.WHOLE),
        "phi": _PHI,
    },
    terms=on(("play",), Term(GAP, eccentric_gap, ("e", "N", "phi")), Term(GAP_RATE, eccentric_rate, ("e", "N", "phi"))),
    amplitudes=("e",),
    guesses=lambda scales: grid(e=[0.1 * scales.d, 0.03 * scales.d], N=turns(scales, MOST_TEETH), phi=PHASES[:2]),
    words=Words(
        "a gear out of true",
        "The driving gear runs out of true, {N} times a turn, by {e.size}.",
        "Look for a gear that sits askew or off centre on its shaft, a bent shaft, or a worn bore.",
        lambda values: values["N"] != 1,
        "The driving gear runs out of true, once a turn, by {e.size}.",
    ),
)
CONTACT_ASYMMETRY = Effect(
    id="contact_asymmetry",
    equation="beta -> beta ratio where delta_d > 0",
    summary="beta differs between the two flanks",
    acts_on=ActsOn.CONTACT,
    bases=("play",),
    parameters={
        "ratio": Parameter(
            2.0, "", 0.01, 100.0, False, "guess", "beta of flank delta_d > 0 over the other's", Domain.POSITIVE
        )
    },
    terms=on(("play",), Term(FORCE, asymmetric, ("ratio", "beta", "n", "d"))),
    guesses=lambda scales: grid(ratio=(0.4, 2.5, 6.0)),
    barely=lambda scales: [{"ratio": 1.02}],
    words=Words(
        "flanks that differ",
        "The teeth are harder on the one flank, that which holds the joint back, by a factor of {ratio}.",
        "Look at both flanks of the teeth: wear on one side, a chipped tooth, plastic that was pressed flat.",
        lambda values: values["ratio"] >= 1,
        "The teeth are softer on the one flank, that which holds the joint back, by a factor of {ratio.inverse}.",
    ),
)
_TAU_R = Parameter(2e-4, "N m", -0.1, 0.1, False, "guess", "amplitude")
_RIPPLES = Parameter(12.0, "", 1, MOST_RIPPLES, True, "guess", "periods a turn", Domain.WHOLE)
TORQUE_RIPPLE = Effect(
    id="torque_ripple",
    equation="tau_r sin(N theta_2 + phi)",
    summary="cogging or gear ripple: a torque that repeats with the angle",
    acts_on=ActsOn.JOINT,
    bases=JOINTS,
    parameters={
        "tau_r": _TAU_R,
        "N": _RIPPLES,
        "phi": _PHI,
    },
    terms=on(JOINTS, Term(TORQUE, ripple, ("tau_r", "N", "phi"))),
    rate=_ripple_rate,
    defaults={
        "joint": {"tau_r": joint_sized(_TAU_R)},
        "servo": {"tau_r": servo_sized(_TAU_R), "N": replace(_RIPPLES, high=MOST_TEETH)},
    },
    amplitudes=("tau_r",),
    guesses=lambda scales: grid(tau_r=[0.05 * scales.torque], N=turns(scales, MOST_RIPPLES), phi=PHASES[:2]),
    words=Words(
        "a torque that ripples",
        "The torque ripples {N} times a turn, by {tau_r.size}.",
        "Look for a damaged tooth, a bearing with a flat ball, or a motor that cogs; the number of periods per turn "
        "shows which.",
        lambda values: values["N"] != 1,
        "The torque ripples once a turn, by {tau_r.size}.",
    ),
)
