"""The oscillator, eqs. 6 and 7: its terms on the bar of a joint, and the base ``oscillator`` that stands alone."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

from lostmotion.model.base import Base, Fusion, Operating, State, Term
from lostmotion.model.kernel import Slots, kernel
from lostmotion.model.parameter import Domain, Parameter
from lostmotion.model.signals import (
    ALPHA2,
    BAR_FORCE,
    DISPLACED,
    FORCE,
    INERTIA,
    Q_RATE,
    QDD,
    READING,
    SENSOR,
    TIP,
    TORQUE,
    Q,
)

__all__ = ["BASE", "FUSION", "ON_BAR", "PARAMETERS", "SENSOR_TERMS", "STATES", "bar_rate"]

_F_RES, _ZETA, _M = 58.0, 0.012, 0.02
_K = _M * (2 * math.pi * _F_RES) ** 2

PARAMETERS: Mapping[str, Parameter] = {
    "m": Parameter(_M, "kg", 1e-4, 100.0, True, "guess: an accelerometer board and half the bar", "generalised mass",
                   Domain.POSITIVE),
    "b": Parameter(2 * _ZETA * math.sqrt(_K * _M), "N s/m", 0.0, 1e3, False, "guess: damping ratio 0.012", "damping",
                   Domain.NOT_NEGATIVE),
    "k": Parameter(_K, "N/m", 1e-3, 1e8, False, "chosen: 58 Hz, below what 200 Hz sampling allows", "stiffness",
                   Domain.POSITIVE),
}  # fmt: skip
STATES = (State("q", Q, Q_RATE), State("q'", Q_RATE, QDD))


@kernel
def spring_and_damper(s: Slots, x: Slots, dx: Slots, p: Slots) -> float:
    """-(b q' + k q); p: b, k."""
    return -p[0] * s[Q_RATE] - p[1] * s[Q]


@kernel
def on_bar(s: Slots, x: Slots, dx: Slots, p: Slots) -> float:
    """q'' = force/m - omega_2' l (eq. 7); p: m, l."""
    return s[BAR_FORCE] * (1.0 / p[0]) - p[1] * s[ALPHA2]


@kernel
def tip_on_bar(s: Slots, x: Slots, dx: Slots, p: Slots) -> float:
    """The absolute acceleration q'' + omega_2' l that an accelerometer feels; p: l."""
    return s[QDD] + p[0] * s[ALPHA2]


@kernel
def filtered(s: Slots, x: Slots, dx: Slots, p: Slots) -> float:
    """A sensor without a filter."""
    return s[TIP]


@kernel
def reading(s: Slots, x: Slots, dx: Slots, p: Slots) -> float:
    """The sensor's output without an offset."""
    return s[SENSOR]


@kernel
def fused_bar(s: Slots, x: Slots, dx: Slots, p: Slots) -> float:
    """theta_2'', spring_and_damper and on_bar in one call; p: b, k, m, l."""
    s[ALPHA2] = s[TORQUE] * (1.0 / s[INERTIA])
    s[BAR_FORCE] = -p[0] * s[Q_RATE] - p[1] * s[Q]
    return s[BAR_FORCE] * (1.0 / p[2]) - p[3] * s[ALPHA2]


@kernel
def driven(s: Slots, x: Slots, dx: Slots, p: Slots) -> float:
    """F + bias - b q' - k q; p: b, k, bias."""
    return s[FORCE] + p[2] - p[0] * s[Q_RATE] - p[1] * s[Q]


@kernel
def alone(s: Slots, x: Slots, dx: Slots, p: Slots) -> float:
    """q'' = force/m (eq. 6); p: m."""
    return s[BAR_FORCE] / p[0]


@kernel
def tip_alone(s: Slots, x: Slots, dx: Slots, p: Slots) -> float:
    """The acceleration of the mass, q''."""
    return s[QDD]


@kernel
def displaced(s: Slots, x: Slots, dx: Slots, p: Slots) -> float:
    """The displacement of the mass, q."""
    return s[Q]


ON_BAR = (Term(BAR_FORCE, spring_and_damper, ("b", "k")), Term(QDD, on_bar, ("m", "l")), Term(TIP, tip_on_bar, ("l",)))
FUSION = Fusion((ALPHA2, BAR_FORCE, QDD), fused_bar, ("b", "k", "m", "l"))
SENSOR_TERMS = (Term(SENSOR, filtered), Term(READING, reading))


def bar_rate(values: Mapping[str, float], operating: Operating) -> float:
    """Four times the natural frequency [rad/s]: it rings for many periods, so errors of phase add up."""
    return 4 * math.sqrt(values["k"] / values["m"])


def _start(values: Mapping[str, float], force: float, rate: float, acceleration: float) -> tuple[float, ...]:
    return (0.0, 0.0)


BASE = Base(
    id="oscillator",
    equation="m q'' + b q' + k q = F + bias",
    summary="a damped oscillator, driven by a force or ringing down (eq. 6)",
    parameters={
        **PARAMETERS,
        "m": replace(PARAMETERS["m"], low=1e-12, high=1e9, fixed=False),
        "b": replace(PARAMETERS["b"], high=1e12),
        "k": replace(PARAMETERS["k"], low=1e-9, high=1e15),
        "bias": Parameter(0.0, "N", -1e9, 1e9, False, "none expected", "constant force, an offset of the input"),
    },
    states=STATES,
    terms=(
        Term(BAR_FORCE, driven, ("b", "k", "bias")),
        Term(QDD, alone, ("m",)),
        Term(TIP, tip_alone),
        *SENSOR_TERMS,
        Term(DISPLACED, displaced),
    ),
    outputs={"force": FORCE, "displacement": DISPLACED, "velocity": Q_RATE, "accel": READING},
    watched=BAR_FORCE,
    rate=bar_rate,
    start=_start,
    input_signals=((FORCE, 0),),
    scale="m",
)
