"""The base ``play``: the gears of eqs. 1-5 carrying the oscillator of eqs. 6-7, driven by the angle theta_1.

As in the paper the bar's reaction on the joint is neglected: J2 holds its inertia, but its swinging does not turn the
gear back.  The accelerometer feels the absolute tip acceleration q'' + omega_2' l = -(b q' + k q)/m, plus its bias.
"""

from __future__ import annotations

from collections.abc import Mapping

from lostmotion.model import gear, oscillator
from lostmotion.model.base import Base, Fusion, Operating, State, Term
from lostmotion.model.kernel import Slots, kernel, whole_power
from lostmotion.model.parameter import Domain, Parameter
from lostmotion.model.signals import (
    ALPHA2,
    BAR_FORCE,
    COMMAND,
    COMMAND_RATE,
    FORCE,
    GAP,
    GAP_RATE,
    INERTIA,
    OMEGA1,
    OMEGA2,
    Q_RATE,
    READING,
    SENSOR,
    THETA1,
    THETA2,
    TORQUE,
    Q,
)

__all__ = ["BASE"]


@kernel
def biased(s: Slots, x: Slots, dx: Slots, p: Slots) -> float:
    """The sensor's output with its constant offset; p: bias."""
    return s[SENSOR] + p[0]


@kernel
def fused(s: Slots, x: Slots, dx: Slots, p: Slots) -> float:
    """Eqs. 1-7 in one call, as the single terms have them; p: as FUSION names them."""
    gap = p[1] * s[THETA2] - p[0] * s[THETA1]
    gap_rate = p[1] * s[OMEGA2] - p[0] * s[OMEGA1]
    closed = gap * (2.0 / p[5])
    force = whole_power(closed, p[4]) * (p[2] + p[3] * gap_rate * closed)
    torque = -p[1] * force
    alpha2 = torque * (1.0 / s[INERTIA])
    bar_force = -p[6] * s[Q_RATE] - p[7] * s[Q]
    s[GAP], s[GAP_RATE], s[FORCE], s[TORQUE], s[ALPHA2], s[BAR_FORCE] = gap, gap_rate, force, torque, alpha2, bar_force
    return bar_force * (1.0 / p[8]) - p[9] * alpha2


FUSION = Fusion(
    (*gear.FUSION.covers, *oscillator.FUSION.covers), fused, (*gear.FUSION.parameters, *oscillator.FUSION.parameters)
)


def _rate(values: Mapping[str, float], operating: Operating) -> float:
    return max(gear.contact_rate(values, operating), oscillator.bar_rate(values, operating))


def _start(values: Mapping[str, float], angle: float, rate: float, acceleration: float) -> tuple[float, ...]:
    """Gears together, gap centred, the bar bent as the acceleration holds it, so that the start makes no ringing."""
    ratio = values["R1"] / values["R2"]
    bent = -values["m"] * values["l"] * ratio * acceleration / values["k"]
    return (angle * ratio, rate * ratio, bent, 0.0)


BASE = Base(
    id="play",
    equation="J2 theta_2'' = -F_cnt R2; m (q'' + theta_2'' l) + b q' + k q = 0",
    summary="two spur gears with play between them and an oscillator on the driven one (eqs. 1-7)",
    parameters={
        **gear.PARAMETERS,
        "l": Parameter(0.10, "m", 1e-2, 2.0, False, "guess: the length of the bar", "bar length", Domain.POSITIVE),
        **oscillator.PARAMETERS,
        "bias": Parameter(0.0, "m/s^2", -20.0, 20.0, False, "none expected", "offset of the accelerometer"),
    },
    states=(State("theta_2", THETA2, OMEGA2), State("omega_2", OMEGA2, ALPHA2), *oscillator.STATES),
    terms=(*gear.TERMS, *oscillator.ON_BAR, oscillator.SENSOR_TERMS[0], Term(READING, biased, ("bias",))),
    outputs={
        "command": COMMAND,
        "position": THETA2,
        "velocity": OMEGA2,
        "acceleration": ALPHA2,
        "accel": READING,
        "force": FORCE,
        "torque": TORQUE,
        "displacement": Q,
        "gap": GAP,
    },
    watched=FORCE,
    rate=_rate,
    start=_start,
    input_signals=((COMMAND, 0), (COMMAND_RATE, 1), (THETA1, 0), (OMEGA1, 1)),
    presets={INERTIA: "J2"},
    fusions=(FUSION, gear.FUSION, oscillator.FUSION),
)
