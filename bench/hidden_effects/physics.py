"""Eqs. 1-7 of the paper and every effect on them, once more: numba right-hand side, LSODA with a short longest step.

Nothing of lostmotion is used.  An effect that is absent has a neutral value (NEUTRAL), so one right-hand side serves
all.  The contact force is flat in the gap (X^11), where a free step would grow over the next impact unseen: hmax.
"""

from __future__ import annotations

import math
from collections import namedtuple
from collections.abc import Mapping
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.integrate import odeint

__all__ = ["NEUTRAL", "STATES", "Command", "Values", "follow", "layout", "motion", "simulate"]

FloatArray = NDArray[np.float64]
Values = Mapping[str, float]
G = 9.80665
LONGEST_STEP = 2e-4
OFF = 1e9
"""For a value that has no effect when it is huge."""

NEUTRAL: dict[str, float] = {
    "R1": 0.01, "R2": 0.01, "J2": 2e-4, "beta": 20.0, "alpha": 4000.0, "n": 11.0, "d": 8e-5, "l": 0.1, "m": 0.02,
    "b": 0.175, "k": 2656.0, "bias": 0.0,
    "viscous_friction.b_v": 0.0,
    "coulomb_friction.tau_c": 0.0, "coulomb_friction.omega_0": 1e-2,
    "stribeck_friction.tau_c": 0.0, "stribeck_friction.tau_s": 0.0, "stribeck_friction.omega_s": 1.0,
    "stribeck_friction.omega_0": 1e-2,
    "load_dependent_friction.mu": 0.0, "load_dependent_friction.omega_0": 1e-2,
    "gravity_torque.tau_g": 0.0, "gravity_torque.phi": 0.0,
    "gear_eccentricity.e": 0.0, "gear_eccentricity.N": 1.0, "gear_eccentricity.phi": 0.0,
    "shaft_compliance.share": 1.0, "shaft_compliance.k_s": 0.0, "shaft_compliance.c_s": 0.0,
    "actuator_lag.T": 0.0,
    "command_delay.T": 0.0,
    "finite_actuator.J1": 0.0, "finite_actuator.f1": 0.0, "finite_actuator.zeta1": 0.0,
    "contact_asymmetry.ratio": 1.0,
    "hardening_spring.k3": 0.0,
    "quadratic_damping.b2": 0.0,
    "second_mode.f2": 100.0, "second_mode.zeta2": 0.02, "second_mode.participation": 0.0,
    "gravity_leakage.c": 0.0, "gravity_leakage.phi": 0.0,
    "centripetal_crosstalk.c": 0.0,
    "sensor_lag.T": 0.0,
    "sensor_saturation.a_max": OFF,
    "clock_skew.s": 0.0,
    "bias_drift.c": 0.0,
    "tight_spot.tau_t": 0.0, "tight_spot.angle": 0.0, "tight_spot.width": 1.0,
    "hysteresis.tau_h": 0.0, "hysteresis.reach": 1.0,
    "hum.a": 0.0, "hum.f": 0.0, "hum.phi": 0.0,
    "quadratic_spring.k2": 0.0,
    "cubic_friction.b3": 0.0,
    "shaking.tau": 0.0, "shaking.f": 0.0, "shaking.phi": 0.0,
    "curved_sensor.c": 0.0,
}  # fmt: skip
"""Every value that the equations know, SI units, each effect absent; those behind `tight_spot` are in no catalogue."""

Layout: Any = namedtuple("Layout", " ".join(NEUTRAL).replace(".", "__"))  # type: ignore[misc]
"""The same as compiled functions take them."""
STATES = ("theta_2", "omega_2", "q", "q'", "theta_1", "omega_1", "near", "near'", "q2", "q2'", "filtered", "z")


class Command:
    """theta_1 as commanded: piecewise cubic. coefficients: (K, 4), highest power first, each piece `step` s long."""

    def __init__(self, start: float, step: float, coefficients: FloatArray) -> None:
        self.start, self.step, self.coefficients = start, step, np.ascontiguousarray(coefficients)

    @property
    def where(self) -> tuple[float, float, FloatArray]:
        """Start, step and coefficients, as the compiled functions take them."""
        return self.start, self.step, self.coefficients

    def at(self, times: FloatArray) -> FloatArray:
        """The angle [rad] at the times."""
        return np.array([_command(t, self.start, self.step, self.coefficients)[0] for t in times])


@njit(cache=True)
def _command(t, start, step, coefficients):  # type: ignore[no-untyped-def]
    """Angle, its rate and acceleration."""
    i = min(max(int((t - start) / step), 0), coefficients.shape[0] - 1)
    u = t - start - i * step
    c3, c2, c1, c0 = coefficients[i]
    return ((c3 * u + c2) * u + c1) * u + c0, (3 * c3 * u + 2 * c2) * u + c1, 6 * c3 * u + 2 * c2


@njit(cache=True)
def motion(y, t, v, start, step, coefficients, out):  # type: ignore[no-untyped-def]
    """Sets the derivatives (12,) and gives the acceleration that the accelerometer feels."""
    theta2, omega2, q, dq, x1, dx1, near, dnear, q2, dq2, filtered, z = y
    out[:] = 0.0
    aim, daim, _ = _command(t - v.command_delay__T, start, step, coefficients)
    theta1, omega1 = aim, daim
    if v.actuator_lag__T > 0.0:
        out[4] = (aim - x1) / v.actuator_lag__T
        theta1, omega1 = x1, out[4]
    if v.finite_actuator__J1 > 0.0:
        w1 = 2 * math.pi * v.finite_actuator__f1
        theta1, omega1 = x1, dx1
        out[4] = dx1
        out[5] = w1 * w1 * (aim - x1) + 2 * v.finite_actuator__zeta1 * w1 * (daim - dx1)
    flexible = v.shaft_compliance__share < 1.0
    gear, dgear = (near, dnear) if flexible else (theta2, omega2)
    turn = v.gear_eccentricity__N
    gap, dgap = gear * v.R2 - theta1 * v.R1, dgear * v.R2 - omega1 * v.R1
    if v.gear_eccentricity__e > 0.0:
        gap += v.gear_eccentricity__e * math.sin(turn * theta1 + v.gear_eccentricity__phi)
        dgap += v.gear_eccentricity__e * turn * omega1 * math.cos(turn * theta1 + v.gear_eccentricity__phi)
    closed = gap / (v.d / 2)
    flank = closed ** int(v.n)
    force = v.beta * flank * (v.contact_asymmetry__ratio if closed > 0 else 1.0) + v.alpha * dgap * flank * closed
    if v.finite_actuator__J1 > 0.0:
        out[5] += force * v.R1 / v.finite_actuator__J1
    torque, inertia = -force * v.R2, v.J2
    if flexible:
        shaft = v.shaft_compliance__k_s * (near - theta2) + v.shaft_compliance__c_s * (dnear - omega2)
        out[6] = dnear
        out[7] = (torque - shaft) / ((1.0 - v.shaft_compliance__share) * v.J2)
        torque, inertia = shaft, v.shaft_compliance__share * v.J2
    out[11] = omega2 - abs(omega2) * z / v.hysteresis__reach
    torque += _on_joint(v, t, theta2, omega2, force, z)
    alpha2 = torque / inertia
    bar = -v.b * dq - v.k * q - v.hardening_spring__k3 * q**3 - v.quadratic_damping__b2 * dq * abs(dq)
    bar -= v.quadratic_spring__k2 * q * q
    out[0], out[1], out[2] = omega2, alpha2, dq
    out[3] = bar / v.m - v.l * alpha2
    felt = bar / v.m
    if v.second_mode__participation != 0.0:
        w2 = 2 * math.pi * v.second_mode__f2
        out[8] = dq2
        out[9] = -2 * v.second_mode__zeta2 * w2 * dq2 - w2 * w2 * q2 - v.second_mode__participation * v.l * alpha2
        felt += out[9]
    if v.gravity_leakage__c != 0.0:
        felt += v.gravity_leakage__c * G * math.sin(theta2 + v.gravity_leakage__phi)
    felt += v.centripetal_crosstalk__c * omega2 * omega2 * v.l
    if v.sensor_lag__T > 0.0:
        out[10] = (felt - filtered) / v.sensor_lag__T
        felt = filtered
    return felt


@njit(cache=True)
def _on_joint(v, t, theta, omega, force, z):  # type: ignore[no-untyped-def]
    """Torque of the effects on the joint, the hysteresis' state z in rad."""
    torque = -v.viscous_friction__b_v * omega - v.cubic_friction__b3 * omega**3
    if v.coulomb_friction__tau_c > 0.0:
        torque -= v.coulomb_friction__tau_c * math.tanh(omega / v.coulomb_friction__omega_0)
    if v.stribeck_friction__tau_s > 0.0:
        fall = math.exp(-((omega / v.stribeck_friction__omega_s) ** 2))
        dry = v.stribeck_friction__tau_c + (v.stribeck_friction__tau_s - v.stribeck_friction__tau_c) * fall
        torque -= dry * math.tanh(omega / v.stribeck_friction__omega_0)
    if v.load_dependent_friction__mu > 0.0:
        load = v.load_dependent_friction__mu * abs(force) * v.R2
        torque -= load * math.tanh(omega / v.load_dependent_friction__omega_0)
    if v.gravity_torque__tau_g > 0.0:
        torque -= v.gravity_torque__tau_g * math.sin(theta + v.gravity_torque__phi)
    if v.tight_spot__tau_t > 0.0:
        spot = math.exp(-(((theta - v.tight_spot__angle) / v.tight_spot__width) ** 2))
        torque -= v.tight_spot__tau_t * spot * math.tanh(omega / 5e-3)
    torque -= v.hysteresis__tau_h * z / v.hysteresis__reach
    if v.shaking__tau > 0.0:
        torque += v.shaking__tau * math.sin(2 * math.pi * v.shaking__f * t + v.shaking__phi)
    return torque


@njit(cache=True)
def _rhs(y, t, v, start, step, coefficients):  # type: ignore[no-untyped-def]
    out = np.empty(12)
    motion(y, t, v, start, step, coefficients, out)
    return out


@njit(cache=True)
def _felt(states, times, v, start, step, coefficients):  # type: ignore[no-untyped-def]
    out, felt = np.empty(12), np.empty(len(times))
    for i in range(len(times)):
        felt[i] = motion(states[i], times[i], v, start, step, coefficients, out)
    return felt


def layout(values: Values) -> Any:
    """The values in the order of the compiled functions, neutral where none is given.  Raises KeyError."""
    unknown = set(values) - set(NEUTRAL)
    if unknown:
        raise KeyError(f"no value of the equations is called {', '.join(sorted(unknown))}")
    return Layout(*(float(values.get(name, neutral)) for name, neutral in NEUTRAL.items()))


def follow(values: Values, command: Command, time: float) -> FloatArray:
    """The state (12,) that moves along with the command: gap centred, lags settled, bar bent by the acceleration."""
    v = layout(values)
    angle, rate, acceleration = _command(time - v.command_delay__T, command.start, command.step, command.coefficients)
    bent = -v.m * v.l * acceleration / v.k
    state = np.array([angle, rate, bent, 0, angle, rate, angle, rate, 0, 0, 0, 0], dtype=float)
    state[10] = _felt(state[None], np.array([time]), v._replace(sensor_lag__T=0.0), *command.where)[0]
    return state


def simulate(
    values: Values, command: Command, times: FloatArray, state: FloatArray, rtol: float = 1e-9
) -> tuple[FloatArray, FloatArray]:
    """Acceleration behind the sensor's filter (N,) [m/s²], and states (N, 12), at the times, from a state at times[0].

    Offset, drift, range and noise of the sensor are not in it.  Raises ArithmeticError when LSODA fails.
    """
    v, where = layout(values), command.where
    solve: Any = odeint  # its stubs know no compiled functions
    absolute = rtol * np.array([1e-2, 1, 1e-4, 1e-1, 1e-2, 1, 1e-2, 1, 1e-5, 1e-2, 1, 1e-2])
    states, info = solve(
        _rhs, state, times, (v, *where), rtol=rtol, atol=absolute, hmax=LONGEST_STEP, mxstep=1_000_000, full_output=True
    )
    if info["message"] != "Integration successful.":
        raise ArithmeticError(f"LSODA: {info['message']}")
    return _felt(states, times, v, *where), states
