"""The base ``joint``: an inertia turned by a torque, or swinging freely.  Friction and gravity come as effects."""

from __future__ import annotations

from collections.abc import Mapping

from lostmotion.model.base import Base, Operating, State, Term
from lostmotion.model.gear import acceleration
from lostmotion.model.kernel import Slots, kernel
from lostmotion.model.parameter import Domain, Parameter
from lostmotion.model.signals import ALPHA2, FORCE, INERTIA, OMEGA2, THETA2, TORQUE

__all__ = ["BASE"]


@kernel
def applied(s: Slots, x: Slots, dx: Slots, p: Slots) -> float:
    """The torque that is applied, and its constant offset; p: bias."""
    return s[FORCE] + p[0]


def _rate(values: Mapping[str, float], operating: Operating) -> float:
    """None of its own: a torque alone is integrated exactly enough by steps of 4 ms."""
    return 60.0


def _start(values: Mapping[str, float], torque: float, rate: float, acceleration: float) -> tuple[float, ...]:
    return (0.0, 0.0)


BASE = Base(
    id="joint",
    equation="J theta_2'' = tau + bias",
    summary="a joint turned by a torque, or swinging freely",
    parameters={
        "J": Parameter(2e-4, "kg m^2", 1e-12, 1e9, False, "guess: 20 g at 0.1 m", "inertia", Domain.POSITIVE),
        "bias": Parameter(0.0, "N m", -1e9, 1e9, False, "none expected", "constant torque, an offset of the input"),
    },
    states=(State("theta_2", THETA2, OMEGA2), State("omega_2", OMEGA2, ALPHA2)),
    terms=(Term(TORQUE, applied, ("bias",)), Term(ALPHA2, acceleration)),
    outputs={"torque": FORCE, "position": THETA2, "velocity": OMEGA2, "acceleration": ALPHA2},
    watched=TORQUE,
    rate=_rate,
    start=_start,
    input_signals=((FORCE, 0),),
    presets={INERTIA: "J"},
    scale="J",
)
