"""The bar is no ideal oscillator: a spring that hardens, damping that grows with speed, a second mode."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from lostmotion.model.base import Operating, Term
from lostmotion.model.effects.base import JOINT_MOST, ActsOn, Effect, on
from lostmotion.model.effects.guesses import SMALL, MotionScales, Values, grid
from lostmotion.model.effects.words import Words
from lostmotion.model.kernel import Slots, kernel
from lostmotion.model.parameter import Domain, Parameter
from lostmotion.model.signals import ALPHA2, BAR_FORCE, DISPLACED, FORCE, OMEGA2, Q_RATE, TIP, TORQUE, Q

__all__ = ["HARDENING_SPRING", "QUADRATIC_DAMPING", "SECOND_MODE"]

BARS = ("play", "oscillator")
ABOVE = (1.7, 2.2, 2.8, 3.3, 3.8, 4.5, 5.4)
"""Natural frequencies of a second mode over that of the first, from which a search begins.  Bernoulli's clamped bar
has 6.3; a mass at its end, as the sensor is, and a second degree of freedom at the clamp bring it down."""
MOST_DAMPED = math.sqrt(0.5)
"""Damping ratio from which on a mode has no resonance.  To an arm of 3.4 Hz between springs that are not alike modes of
0.04 and 0.006 Hz were fitted, both with a damping ratio of 1, which took four fifths of the squared error: its rest
creeps."""


HARMONICS = (2, 3)
"""Multiples of a frequency that a spring which is not linear or not symmetric makes: of a filmed pendulum a mode at
0.826 Hz was named beside 0.414."""


def _is_resolved(values: Mapping[str, float]) -> bool:
    """Whether a second mode has a resonance, apart from the first by more than the half-power bandwidth of either, and
    from its harmonics where nothing excites the mode (its participation is zero).

    Two modes that overlap more bend into any decay: of a mass on a spring that softens one of 2.84 Hz and a damping
    ratio of 0.15 was named beside one of 2.17 Hz and 0.58, and of a swing that air brakes one 1.5 % beside the first.
    What an input excites is no harmonic: a mode of 196.4 Hz at three times that of a bar was fitted to 0.1 Hz, and has
    a bandwidth of 9 Hz.
    """
    first = math.sqrt(values["k"] / values["m"]) / (2 * math.pi)
    widths = values["b"] / (2 * math.pi * values["m"]), 2 * values["zeta2"] * values["f2"]
    orders = (1,) if values["participation"] else (1, *HARMONICS)
    apart = min(abs(values["f2"] - order * first) for order in orders)
    return values["zeta2"] < MOST_DAMPED and apart > max(widths)


@kernel
def hardening(s: Slots, x: Slots, dx: Slots, p: Slots) -> float:
    """-k3 (q - q_0)³; p: k3, q_0."""
    return -p[0] * (s[Q] - p[1]) ** 3


@kernel
def quadratic_on_bar(s: Slots, x: Slots, dx: Slots, p: Slots) -> float:
    """-b2 q' |q'|; p: b2."""
    return -p[0] * s[Q_RATE] * abs(s[Q_RATE])


@kernel
def quadratic_on_joint(s: Slots, x: Slots, dx: Slots, p: Slots) -> float:
    """-b2 omega |omega|; p: b2."""
    return -p[0] * s[OMEGA2] * abs(s[OMEGA2])


@kernel
def second_mode(s: Slots, x: Slots, dx: Slots, p: Slots) -> float:
    """q2'' = -2 zeta2 w q2' - w² q2 - participation omega_2' l, added at the tip; p: f2, zeta2, participation, l."""
    w = 2 * math.pi * p[0]
    dx[0] = x[1]
    dx[1] = -2 * p[1] * w * x[1] - w * w * x[0] - p[2] * p[3] * s[ALPHA2]
    return dx[1]


@kernel
def second_mode_alone(s: Slots, x: Slots, dx: Slots, p: Slots) -> float:
    """q2'' = -2 zeta2 w q2' - w² q2 + participation F/m, added at the end; p: f2, zeta2, participation, m."""
    w = 2 * math.pi * p[0]
    dx[0] = x[1]
    dx[1] = -2 * p[1] * w * x[1] - w * w * x[0] + p[2] * s[FORCE] / p[3]
    return dx[1]


@kernel
def second_displacement(s: Slots, x: Slots, dx: Slots, p: Slots) -> float:
    """q2, added to the displacement of the end."""
    return x[0]


def _hardening_guesses(scales: MotionScales) -> Sequence[Values]:
    """Shares of the stiffness; without play in front of the bar it rings on undisturbed, so that also a share counts
    that shifts its phase by half a radian from first to last: s / 4 of the frequency."""
    shares = [(0.05, 0.04), (0.15, 0.12), (0.3, 0.22), (-0.05, -0.04), (-0.15, -0.12)]
    if not scales.d and scales.resonance * scales.length > 1:
        least = 1 / (math.pi * scales.resonance * scales.length)
        shares += [(least, 0.8 * least), (-least, -0.8 * least)]
    rest = {"q_0": scales.rest} if scales.rest else {}
    return [{"k3": s * scales.k / (3 * scales.bend**2), "k": scales.k * (1 - part), **rest} for s, part in shares]


def _second_guesses(scales: MotionScales) -> Sequence[Values]:
    """At the lines of the spectrum, and above the natural frequency, as impacts or an input may hide its line."""
    others = [f for f in scales.lines if abs(f - scales.resonance) > 0.1 * scales.resonance]
    return grid(f2=[*others, *(scales.resonance * ratio for ratio in ABOVE)], zeta2=(0.02,), participation=(0.1,))


def _second_rate(values: Mapping[str, float], operating: Operating) -> float:
    """Three times its frequency [rad/s]: it rings on."""
    return 3 * 2 * math.pi * values["f2"]


HARDENING_SPRING = Effect(
    id="hardening_spring",
    equation="-k3 (q - q_0)^3",
    summary="the bar stiffens with deflection (softens for a negative k3)",
    acts_on=ActsOn.OSCILLATOR,
    bases=BARS,
    parameters={
        "k3": Parameter(2e9, "N/m^3", -1e12, 1e12, False, "guess: 10 % of k q at 0.4 mm", "cubic stiffness"),
        "q_0": Parameter(
            0.0, "m", -1e6, 1e6, True, "chosen: the zero of q", "place of rest, about which it is symmetric"
        ),
    },
    terms=on(BARS, Term(BAR_FORCE, hardening, ("k3", "q_0"))),
    amplitudes=("k3",),
    guesses=_hardening_guesses,
    words=Words(
        "a bar that stiffens",
        "The bar stiffens as it bends: its cubic stiffness is {k3}.",
        "Look how the bar is clamped and whether it touches something; gentler reversals, a lighter tip bend it less.",
        lambda values: values["k3"] >= 0,
        "The bar softens as it bends: its cubic stiffness is {k3}.",
    ),
)
QUADRATIC_DAMPING = Effect(
    id="quadratic_damping",
    equation="-b2 q' |q'|; joint, servo: -b2 omega |omega|",
    summary="drag that grows with the square of speed: air",
    acts_on=ActsOn.OSCILLATOR,
    bases=("play", "oscillator", "joint", "servo"),
    parameters={
        "b2": Parameter(
            1.0, "N s^2/m^2", 0.0, 1e4, False, "guess: as much as b at 0.2 m/s", "drag", Domain.NOT_NEGATIVE
        )
    },
    terms={
        **on(BARS, Term(BAR_FORCE, quadratic_on_bar, ("b2",))),
        **on(("joint", "servo"), Term(TORQUE, quadratic_on_joint, ("b2",))),
    },
    defaults={
        base: {"b2": Parameter(value, "N m s^2/rad^2", 0.0, most, False, "guess", "drag", Domain.NOT_NEGATIVE)}
        for base, value, most in (("joint", 1e-5, JOINT_MOST), ("servo", 2e-3, 10.0))
    },
    amplitudes=("b2",),
    likelier="viscous_friction",
    odds=2.0,
    speed_power=2,
    guesses=lambda scales: (
        [{"b2": share * scales.b / scales.swing, "b": scales.b * (1 - 0.6 * share)} for share in (0.3, 0.9)]
        if scales.swing
        else grid(b2=[scales.torque / scales.speed**2 * share for share in SMALL])
    ),
    words=Words(
        "drag that grows with the square of speed",
        "Something brakes with the square of speed, as air does: drag of {b2}.",
        "Look for a broad plate, tape or a loose cable that moves through the air; else it is only air.",
    ),
)
SECOND_MODE = Effect(
    id="second_mode",
    equation="q2'' + 2 zeta2 w2 q2' + w2^2 q2 = -participation omega_2' l, tip: + q2''; oscillator: participation F/m",
    summary="a second bending mode of the same bar",
    acts_on=ActsOn.OSCILLATOR,
    bases=BARS,
    parameters={
        "f2": Parameter(180.0, "Hz", 10.0, 1000.0, False, "guess: above f_res", "frequency", Domain.POSITIVE),
        "zeta2": Parameter(0.02, "", 0.0, 1.0, False, "guess", "damping ratio", Domain.NOT_NEGATIVE),
        "participation": Parameter(0.3, "", -3.0, 3.0, False, "guess", "share of the excitation that it takes"),
    },
    defaults={"oscillator": {"f2": Parameter(180.0, "Hz", 1e-3, 1e6, False, "guess", "frequency", Domain.POSITIVE)}},
    terms={
        "play": (Term(TIP, second_mode, ("f2", "zeta2", "participation", "l")),),
        "oscillator": (
            Term(TIP, second_mode_alone, ("f2", "zeta2", "participation", "m")),
            Term(DISPLACED, second_displacement),
        ),
    },
    states=(None, None),
    free_states=True,
    is_apt=_is_resolved,
    rate=_second_rate,
    amplitudes=("participation",),
    guesses=_second_guesses,
    words=Words(
        "another resonance of the bar",
        "The bar has another resonance, at {f2}.",
        "Look for a loose screw or cable at the sensor; else it is the bar's own, and a low-pass filter takes it away.",
    ),
)  # fmt: skip
