"""What may be hidden: for each effect where it acts, and parameters drawn for a given strength.  No simulation here.

A draw takes a random generator and a strength (1: moderate, about 3: strong, any positive number between) and gives
values by name.  Effects under OUTSIDE are in no catalogue of lostmotion.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

import numpy as np

__all__ = ["ACTS_ON", "INSIDE", "OUTSIDE", "draw", "rough", "true_base"]

Values = dict[str, float]
Random = np.random.Generator
Draw = Callable[[Random, float], Values]


def _angle(rng: Random) -> float:
    return float(rng.uniform(-math.pi, math.pi))


def _smooth(rng: Random) -> float:
    """Speed within which a dry friction changes its sign [rad/s]."""
    return float(np.exp(rng.uniform(math.log(2e-3), math.log(1e-2))))


def _sign(rng: Random) -> float:
    return float(rng.choice((-1.0, 1.0)))


def _near(rng: Random, value: float, factor: float = 1.25) -> float:
    """Between value/factor and value x factor, evenly in the logarithm."""
    return value * float(np.exp(rng.uniform(-1, 1) * math.log(factor)))


def _stribeck(rng: Random, strength: float) -> Values:
    tau_c = _near(rng, 1e-4) * strength
    return {
        "tau_c": tau_c,
        "tau_s": tau_c * rng.uniform(1.8, 3.0),
        "omega_s": _near(rng, 0.25),
        "omega_0": _smooth(rng),
    }


def _shaft(rng: Random, strength: float) -> Values:
    share, frequency = rng.uniform(0.6, 0.9), rng.uniform(110, 150) / strength**0.5
    far = share * 2e-4
    k_s = far * (2 * math.pi * frequency) ** 2
    return {"share": share, "k_s": k_s, "c_s": 2 * rng.uniform(0.02, 0.06) * math.sqrt(k_s * far)}


def _asymmetry(rng: Random, strength: float) -> Values:
    return {"ratio": float((1 + _near(rng, 1.5) * strength) ** _sign(rng))}


def _hardening(rng: Random, strength: float) -> Values:
    return {"k3": _near(rng, 0.06) * strength * 2600.0 / 0.25e-3**2}


def _second_mode(rng: Random, strength: float) -> Values:
    return {"f2": rng.uniform(150, 250), "zeta2": rng.uniform(0.01, 0.03),
            "participation": _near(rng, 0.15) * strength}  # fmt: skip


_DRAWS: Mapping[str, tuple[str, Draw]] = {
    "viscous_friction": ("joint", lambda rng, s: {"b_v": _near(rng, 2e-4) * s}),
    "coulomb_friction": ("joint", lambda rng, s: {"tau_c": _near(rng, 1e-4) * s, "omega_0": _smooth(rng)}),
    "stribeck_friction": ("joint", _stribeck),
    "load_dependent_friction": ("joint", lambda rng, s: {"mu": _near(rng, 0.04) * s, "omega_0": _smooth(rng)}),
    "gravity_torque": ("joint", lambda rng, s: {"tau_g": _near(rng, 3e-4) * s, "phi": rng.uniform(-1, 1)}),
    "shaft_compliance": ("joint", _shaft),
    "gear_eccentricity": ("contact", lambda rng, s: {"e": _near(rng, 4e-6) * s, "N": float(rng.integers(1, 41)),
                                                     "phi": _angle(rng)}),
    "contact_asymmetry": ("contact", _asymmetry),
    "actuator_lag": ("command", lambda rng, s: {"T": _near(rng, 2e-3) * s**0.8}),
    "command_delay": ("command", lambda rng, s: {"T": _near(rng, 2e-3) * s**0.8}),
    "finite_actuator": ("command", lambda rng, s: {"J1": _near(rng, 1e-3), "f1": _near(rng, 30.0, 1.15) / s**0.5,
                                                   "zeta1": rng.uniform(0.5, 0.9)}),
    "hardening_spring": ("oscillator", _hardening),
    "quadratic_damping": ("oscillator", lambda rng, s: {"b2": _near(rng, 0.7) * s}),
    "second_mode": ("oscillator", _second_mode),
    "gravity_leakage": ("sensor", lambda rng, s: {"c": _sign(rng) * _near(rng, 0.04) * s, "phi": rng.uniform(-1, 1)}),
    "centripetal_crosstalk": ("sensor", lambda rng, s: {"c": _sign(rng) * _near(rng, 0.3) * s}),
    "sensor_lag": ("sensor", lambda rng, s: {"T": _near(rng, 6e-4) * s}),
    "sensor_saturation": ("sensor", lambda rng, s: {"share": 1 - 0.15 * min(s, 5.0) ** 0.8}),
    "clock_skew": ("sensor", lambda rng, s: {"s": _sign(rng) * _near(rng, 8e-4) * s}),
    "bias_drift": ("sensor", lambda rng, s: {"c": _sign(rng) * _near(rng, 0.08) * s}),
}  # fmt: skip
_OUTSIDE: Mapping[str, tuple[str, Draw]] = {
    "tight_spot": ("joint", lambda rng, s: {"tau_t": _near(rng, 3e-4) * s, "angle": rng.uniform(-0.08, 0.08),
                                            "width": rng.uniform(0.02, 0.05)}),
    "hysteresis": ("joint", lambda rng, s: {"tau_h": _near(rng, 2e-4) * s, "reach": rng.uniform(0.05, 0.15)}),
    "hum": ("sensor", lambda rng, s: {"a": _near(rng, 0.3) * s, "f": rng.uniform(30, 200), "phi": _angle(rng)}),
    "quadratic_spring": ("oscillator", lambda rng, s: {"k2": _near(rng, 0.1) * s * 2600.0 / 0.25e-3}),
    "cubic_friction": ("joint", lambda rng, s: {"b3": _near(rng, 2e-4) * s}),
    "shaking": ("joint", lambda rng, s: {"tau": _near(rng, 1.5e-4) * s, "f": rng.uniform(3, 12), "phi": _angle(rng)}),
    "curved_sensor": ("sensor", lambda rng, s: {"c": _sign(rng) * _near(rng, 2e-3) * s}),
}  # fmt: skip
INSIDE, OUTSIDE = tuple(_DRAWS), tuple(_OUTSIDE)
ACTS_ON = {name: where for name, (where, _) in {**_DRAWS, **_OUTSIDE}.items()}


def draw(effect: str, rng: Random, strength: float) -> Values:
    """Parameters of the effect as "effect.name"; sensor_saturation has a `share` of the peak in place of a_max."""
    _, drawn = {**_DRAWS, **_OUTSIDE}[effect]
    return {f"{effect}.{name}": float(value) for name, value in drawn(rng, strength).items()}


def true_base(rng: Random, alpha: tuple[float, float]) -> Values:
    """The joint and its bar, alpha [N s/m] within these."""
    m, f_res = 0.02, rng.uniform(45, 75)
    k = m * (2 * math.pi * f_res) ** 2
    values = {"d": rng.uniform(50e-6, 110e-6), "alpha": rng.uniform(*alpha), "l": 0.1 * rng.uniform(0.97, 1.03), "m": m,
              "k": k, "b": 2 * rng.uniform(0.008, 0.02) * math.sqrt(k * m), "bias": rng.uniform(-0.2, 0.2)}  # fmt: skip
    return {name: float(value) for name, value in values.items()}


def rough(true: Values, rng: Random) -> Values:
    """What a user would know: d off by up to 30 %, f_res by 5 %, l by 5 %, alpha and b by a factor of 1.5."""
    return {
        "d": true["d"] * rng.uniform(0.7, 1.3),
        "k": true["k"] * rng.uniform(0.95, 1.05) ** 2,
        "l": true["l"] * rng.uniform(0.95, 1.05),
        "alpha": _near(rng, true["alpha"], 1.5),
        "b": _near(rng, true["b"], 1.5),
    }
