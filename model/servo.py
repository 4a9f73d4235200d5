"""The base ``servo``: a joint driven by a DC motor under proportional position control.

The controller sets the duty cycle kp error_gain (theta_1 - theta_2), capped at ±cap; the supply U times the duty is
the motor's voltage, and its winding R and constant kt (both seen at the output shaft, gears included) give the torque
tau = kt (duty U - kt omega)/R.  Without an input (drive None) the servo is let go: no current, no torque.
The law: kscalelabs/sysid, measured on a Feetech STS3215: "duty cycle = K_P * error_gain * position_error".
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from lostmotion.model.base import Base, Operating, State, Term
from lostmotion.model.gear import acceleration
from lostmotion.model.kernel import Slots, kernel
from lostmotion.model.parameter import Domain, Parameter
from lostmotion.model.signals import (
    ALPHA2,
    COMMAND,
    COMMAND_RATE,
    DRIVEN,
    FORCE,
    INERTIA,
    OMEGA1,
    OMEGA2,
    THETA1,
    THETA2,
    TORQUE,
)

__all__ = ["BASE"]


@kernel
def motor(s: Slots, x: Slots, dx: Slots, p: Slots) -> float:
    """kt (duty U - kt omega)/R while driven; p: kp, error_gain, cap, U, kt, R."""
    duty = min(max(p[0] * p[1] * (s[THETA1] - s[THETA2]), -p[2]), p[2])
    return s[DRIVEN] * p[4] * (duty * p[3] - p[4] * s[OMEGA2]) / p[5]


@kernel
def transmitted(s: Slots, x: Slots, dx: Slots, p: Slots) -> float:
    """The motor's torque on the joint."""
    return s[FORCE]


def _rate(values: Mapping[str, float], operating: Operating) -> float:
    """The control loop's natural frequency, three times for its phase, or the motor's own damping [rad/s], a quarter of
    it: what decays that fast is over when a step ends."""
    per_volt = values["kt"] / values["R"] / values["J"]
    loop = 3 * math.sqrt(per_volt * values["U"] * values["kp"] * values["error_gain"])
    return max(loop, per_volt * values["kt"] / 4)


def _start(values: Mapping[str, float], angle: float, rate: float, acceleration: float) -> tuple[float, ...]:
    return (angle, rate)


BASE = Base(
    id="servo",
    equation="J theta_2'' = kt (U sat(kp error_gain (theta_1 - theta_2)) - kt omega)/R",
    summary="a joint driven by a DC motor under proportional position control",
    parameters={
        "J": Parameter(0.02, "kg m^2", 1e-6, 1e2, False, "guess: rotor seen through the gears, and a small arm",
                       "inertia with the rotor's, at the output", Domain.POSITIVE),
        "kp": Parameter(32.0, "", 0.0, 1e4, True, "STS3215: as shipped", "gain set in the servo", Domain.NOT_NEGATIVE),
        "error_gain": Parameter(0.165, "1/rad", 1e-4, 1e2, True, "kscalelabs/sysid: STS3215", "duty per kp and rad",
                                Domain.POSITIVE),
        "cap": Parameter(1.0, "", 0.01, 1.0, True, "guess: the whole supply", "largest duty", Domain.POSITIVE),
        "U": Parameter(12.0, "V", 3.0, 48.0, True, "STS3215, AX-12A: as rated", "supply voltage", Domain.POSITIVE),
        "kt": Parameter(1.2, "N m/A", 1e-2, 1e2, False, "guess: STS3215 stalls at 2.9 N m and 2.7 A",
                        "torque constant at the output", Domain.POSITIVE),
        "R": Parameter(4.4, "Ohm", 1e-2, 1e3, True, "guess: STS3215 stalls at 2.7 A",
                       "winding; not identifiable from angles alone beside J and kt", Domain.POSITIVE),
    },
    states=(State("theta_2", THETA2, OMEGA2), State("omega_2", OMEGA2, ALPHA2)),
    terms=(
        Term(FORCE, motor, ("kp", "error_gain", "cap", "U", "kt", "R")),
        Term(TORQUE, transmitted),
        Term(ALPHA2, acceleration),
    ),
    outputs={"command": COMMAND, "position": THETA2, "velocity": OMEGA2, "acceleration": ALPHA2, "torque": FORCE},
    watched=TORQUE,
    rate=_rate,
    start=_start,
    input_signals=((COMMAND, 0), (COMMAND_RATE, 1), (THETA1, 0), (OMEGA1, 1)),
    presets={INERTIA: "J"},
)  # fmt: skip
