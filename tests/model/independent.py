"""The equations once more, in plain NumPy and SciPy's LSODA: what the compiled model is held against.

Written from the paper and from the catalogue's one-line equations; imports nothing of ours.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

FloatArray = NDArray[np.float64]
Scalar = Callable[[float], float]
Values = Mapping[str, float]

G = 9.80665


def lsoda(rhs: Callable[[float, FloatArray], list[float]], start: list[float], times: FloatArray) -> FloatArray:
    """States (n, N) at the times (N,)."""
    span = (float(times[0]), float(times[-1]))
    solution = solve_ivp(rhs, span, start, "LSODA", t_eval=times, rtol=1e-9, atol=1e-12)
    assert solution.success
    return np.asarray(solution.y)


class Play:
    """Eqs. 1-7 with every effect of the catalogue that has a place in them, switched by the presence of its values."""

    def __init__(self, values: Values, command: Scalar, rate: Scalar, acceleration: Scalar) -> None:
        self.v, self.command, self.rate, self.acceleration = values, command, rate, acceleration
        self._effects = {name.partition(".")[0] for name in values if "." in name}

    def has(self, effect: str) -> bool:
        """Whether the effect acts."""
        return effect in self._effects

    def start(self, time: float) -> list[float]:
        """Moving along with the command: joint, bar, actuator, near shaft, second mode, sensor filter."""
        late = time - self.v.get("command_delay.T", 0.0)
        angle, speed = self.command(late), self.rate(late)
        bent = -self.v["m"] * self.v["l"] * self.acceleration(late) / self.v["k"]
        return [angle, speed, bent, 0, angle, speed, angle, speed, 0, 0, 0]

    def parts(self, t: float, y: FloatArray) -> tuple[list[float], float]:
        """Derivatives of the eleven states, and the acceleration that the sensor feels."""
        v = self.v
        theta2, omega2, q, dq, x1, dx1, near, dnear, q2, dq2, filtered = y
        t_command = t - v.get("command_delay.T", 0.0)
        aim, daim = self.command(t_command), self.rate(t_command)
        theta1, omega1, ddx1, first = aim, daim, 0.0, 0.0
        if self.has("actuator_lag"):
            first = (aim - x1) / v["actuator_lag.T"]
            theta1, omega1 = x1, first
        if self.has("finite_actuator"):
            w, theta1, omega1, first = 2 * math.pi * v["finite_actuator.f1"], x1, dx1, dx1
            ddx1 = w * w * (aim - x1) + 2 * v["finite_actuator.zeta1"] * w * (daim - dx1)
        gear, dgear = (near, dnear) if self.has("shaft_compliance") else (theta2, omega2)
        gap, dgap = gear * v["R2"] - theta1 * v["R1"], dgear * v["R2"] - omega1 * v["R1"]
        if self.has("gear_eccentricity"):
            e, n_turn, phi = (v[f"gear_eccentricity.{name}"] for name in ("e", "N", "phi"))
            gap += e * math.sin(n_turn * theta1 + phi)
            dgap += e * n_turn * omega1 * math.cos(n_turn * theta1 + phi)
        closed, n = gap / (v["d"] / 2), int(v["n"])
        beta = v["beta"] * (v.get("contact_asymmetry.ratio", 1.0) if gap > 0 else 1.0)
        force = beta * closed**n + v["alpha"] * dgap * closed ** (n + 1)
        if self.has("finite_actuator"):
            ddx1 += force * v["R1"] / v["finite_actuator.J1"]
        inertia, torque, ddnear = v["J2"], -force * v["R2"], 0.0
        if self.has("shaft_compliance"):
            share = v["shaft_compliance.share"]
            shaft = v["shaft_compliance.k_s"] * (near - theta2) + v["shaft_compliance.c_s"] * (dnear - omega2)
            inertia, ddnear, torque = share * v["J2"], (torque - shaft) / ((1 - share) * v["J2"]), shaft
        torque += joint_torque(v, theta2, omega2, force * v["R2"])
        alpha2 = torque / inertia
        bar = -v["b"] * dq - v["k"] * q + bar_force(v, q, dq)
        ddq = bar / v["m"] - v["l"] * alpha2
        felt, ddq2 = ddq + v["l"] * alpha2, 0.0
        if self.has("second_mode"):
            w = 2 * math.pi * v["second_mode.f2"]
            ddq2 = -2 * v["second_mode.zeta2"] * w * dq2 - w * w * q2 - v["second_mode.participation"] * v["l"] * alpha2
            felt += ddq2
        if self.has("gravity_leakage"):
            felt += v["gravity_leakage.c"] * G * math.sin(theta2 + v["gravity_leakage.phi"])
        felt += v.get("centripetal_crosstalk.c", 0.0) * omega2**2 * v["l"]
        dfiltered = (felt - filtered) / v["sensor_lag.T"] if self.has("sensor_lag") else 0.0
        return [omega2, alpha2, dq, ddq, first, ddx1, dnear, ddnear, dq2, ddq2, dfiltered], felt

    def solve(self, times: FloatArray) -> dict[str, FloatArray]:
        """position, velocity and accel at the times."""
        start = self.start(float(times[0]))
        start[10] = self.parts(float(times[0]), np.array(start))[1]
        y = lsoda(lambda t, state: self.parts(t, state)[0], start, times)
        felt = np.array([self.parts(float(t), column)[1] for t, column in zip(times, y.T, strict=True)])
        reading = y[10] if self.has("sensor_lag") else felt
        reading = reading + self.v["bias"] + self.v.get("bias_drift.c", 0.0) * times
        limit = self.v.get("sensor_saturation.a_max", math.inf)
        return {"position": y[0], "velocity": y[1], "accel": np.clip(reading, -limit, limit)}


def joint_torque(v: Values, theta: float, omega: float, transmitted: float) -> float:
    """The effects that act on the joint as a torque [N m]."""

    def of(effect: str, *names: str) -> list[float] | None:
        found = [v.get(f"{effect}.{name}") for name in names]
        return None if None in found else [value for value in found if value is not None]

    torque = -v.get("viscous_friction.b_v", 0.0) * omega
    if p := of("coulomb_friction", "tau_c", "omega_0"):
        torque -= p[0] * math.tanh(omega / p[1])
    if p := of("stribeck_friction", "tau_c", "tau_s", "omega_s", "omega_0"):
        torque -= (p[0] + (p[1] - p[0]) * math.exp(-((omega / p[2]) ** 2))) * math.tanh(omega / p[3])
    if p := of("load_dependent_friction", "mu", "omega_0"):
        torque -= p[0] * abs(transmitted) * math.tanh(omega / p[1])
    if p := of("gravity_torque", "tau_g", "phi"):
        torque -= p[0] * math.sin(theta + p[1])
    if p := of("torque_ripple", "tau_r", "N", "phi"):
        torque += p[0] * math.sin(p[1] * theta + p[2])
    torque += v.get("constant_torque.tau_0", 0.0) - v.get("spring_torque.k_s", 0.0) * theta
    if "J" in v and (p := of("quadratic_damping", "b2")):
        torque -= p[0] * omega * abs(omega)
    return torque


def friction_left(v: Values, y: float, omega: float) -> tuple[float, float]:
    """What a hysteresis takes back of dry friction [N m], and the rate of its state y."""
    if x_p := v.get("presliding_friction.x_p"):
        sign = math.tanh(omega / v["presliding_friction.omega_0"])
        return -v["presliding_friction.tau_p"] * (y - sign), omega / x_p * (1 - y * math.copysign(1, omega))
    if play := v.get("friction_behind_play.e"):
        z = min(max(abs(y) - play / 2, 0.0) / (v["friction_behind_play.c"] * play), 1.0)
        return -v["friction_behind_play.tau_p"] * math.copysign(z, y), omega * (1 - z if y * omega > 0 else 1)
    return 0.0, 0.0


def bar_force(v: Values, q: float, dq: float) -> float:
    """The effects that act on the oscillator as a force [N]."""
    drag = v.get("quadratic_damping.b2", 0.0) * dq * abs(dq)
    if "J2" not in v:  # of gears, friction is the joint's
        drag += v.get("coulomb_friction.tau_c", 0.0) * math.tanh(dq / v.get("coulomb_friction.omega_0", 1.0))
    return -v.get("hardening_spring.k3", 0.0) * q**3 - drag


def oscillator(v: Values, force: Scalar, start: list[float], times: FloatArray) -> FloatArray:
    """Displacement of eq. 6 with a force."""

    def rhs(t: float, y: FloatArray) -> list[float]:
        return [y[1], (force(t) + v["bias"] - v["b"] * y[1] - v["k"] * y[0] + bar_force(v, y[0], y[1])) / v["m"]]

    return np.asarray(lsoda(rhs, start, times)[0])


def joint(v: Values, torque: Scalar, start: list[float], times: FloatArray) -> FloatArray:
    """Position of J theta'' = torque + effects."""

    def rhs(t: float, y: FloatArray) -> list[float]:
        tau = torque(t)
        left, change = friction_left(v, y[2], y[1])
        return [y[1], (tau + v["bias"] + joint_torque(v, y[0], y[1], tau) + left) / v["J"], change]

    return np.asarray(lsoda(rhs, [*start, 0.0], times)[0])


FINE = 1e-4
"""Step of a command with a limited speed [s]."""


def servo(v: Values, command: Scalar, start: list[float], times: FloatArray) -> FloatArray:
    """Position of a DC servo under proportional control; the third state is a first-order lag of the command, which may
    have a limited speed, step by step."""
    if limit := v.get("velocity_limit.omega_max"):
        fine = np.arange(times[0], times[-1] + FINE, FINE)
        wanted = [command(t) for t in fine]
        followed = [wanted[0]]
        for aim in wanted[1:]:
            followed.append(followed[-1] + min(max(aim - followed[-1], -limit * FINE), limit * FINE))
        command = lambda t: float(np.interp(t, fine, followed))  # noqa: E731

    def rhs(t: float, y: FloatArray) -> list[float]:
        lag = v.get("actuator_lag.T")
        late = command(t - v.get("command_delay.T", 0.0))
        aim = y[2] if lag else late
        duty = max(-v["cap"], min(v["cap"], v["kp"] * v["error_gain"] * (aim - y[0])))
        tau = v["kt"] * (duty * v["U"] - v["kt"] * y[1]) / v["R"]
        return [y[1], (tau + joint_torque(v, y[0], y[1], tau)) / v["J"], (late - y[2]) / lag if lag else 0.0]

    return np.asarray(lsoda(rhs, start, times)[0])
