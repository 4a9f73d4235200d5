"""Resonances of a bar and its length for a resonance: a cantilever with a sensor at its end (Euler and Bernoulli).

Pure functions of SI numbers.  ``taps`` measures the finished bar.

The bar's equation E I d4w/dz4 = m' omega² w, clamped at 0, with the mass m_tip at L, has a solution where
x = L (m' omega² / E I)^(1/4) and the ratio mu = m_tip / (m' L) meet

    1 + cos x cosh x + mu x (cos x sinh x - sin x cosh x) = 0.

Source: Blevins, "Formulas for Natural Frequency and Mode Shape", table 8-8.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

__all__ = ["MATERIALS", "Beam", "Material", "dunkerley", "frequencies", "length_for", "rectangle", "rod"]

BARE = (1.8751040687, 4.6940911330)
"""the first two roots x without a mass; with one they lie below, the second above 3.9266, where the tip is at rest"""
HELD = 3.9266023120
STEPS = 60
"""of bisection: a range of 1 m comes down to 1e-18 m"""
RANGE_M = (1e-3, 5.0)


@dataclass(frozen=True, slots=True)
class Material:
    """modulus: Young's, along the bar [Pa]; density [kg/m³]."""

    modulus: float
    density: float


MATERIALS = {
    "steel": Material(200e9, 7850.0),
    "spring-steel": Material(206e9, 7850.0),
    "aluminium": Material(69e9, 2700.0),
    "carbon": Material(125e9, 1550.0),
}
"""Carbon is pultruded with its fibres along the bar; between makers it differs by 15 %, metals by 3 %."""


@dataclass(frozen=True, slots=True)
class Beam:
    """A bar of constant section: stiffness E I [N m²], mass per length m' [kg/m]."""

    stiffness: float
    mass: float


def rectangle(material: Material, width: float, thickness: float) -> Beam:
    """A flat bar [m] that bends across its thickness: I = b h³ / 12."""
    return Beam(material.modulus * width * thickness**3 / 12, material.density * width * thickness)


def rod(material: Material, diameter: float) -> Beam:
    """A round bar [m]: I = pi d⁴ / 64."""
    return Beam(material.modulus * math.pi * diameter**4 / 64, material.density * math.pi * diameter**2 / 4)


def frequencies(beam: Beam, length: float, tip: float = 0.0) -> tuple[float, float]:
    """The first two resonances [Hz] of a bar of a length [m] with a mass [kg] at its end."""
    ratio = tip / (beam.mass * length)

    def frequency_equation(x: float) -> float:
        sway = math.cos(x) * math.sinh(x) - math.sin(x) * math.cosh(x)
        return 1 + math.cos(x) * math.cosh(x) + ratio * x * sway

    first = _root(frequency_equation, 1e-6, BARE[0])
    second = _root(frequency_equation, HELD - 1e-6, BARE[1] + 1e-6)
    unit = math.sqrt(beam.stiffness / beam.mass) / length**2 / math.tau
    return first**2 * unit, second**2 * unit


def length_for(beam: Beam, f_res_hz: float, tip: float = 0.0) -> float:
    """The length [m] at which the first resonance is ``f_res_hz`` with a mass [kg] at the end; NaN where
    that is none from 1 mm to 5 m."""
    low, high = RANGE_M
    if not frequencies(beam, high, tip)[0] < f_res_hz < frequencies(beam, low, tip)[0]:
        return math.nan
    return _root(lambda length: frequencies(beam, length, tip)[0] - f_res_hz, low, high)


def dunkerley(beam: Beam, length: float, tip: float = 0.0) -> float:
    """The first resonance [Hz] by Dunkerley's sum 1/omega² = m' L⁴ / (x⁴ E I) + m_tip L³ / (3 E I), never too high.

    With x = 1.8751 that is a spring of 3 E I / L³ under a mass of 3/x⁴ m' L + m_tip, 3/x⁴ = 0.2427: exact without a
    mass and with nothing but a mass, and 0.37 % too low at worst, where the sensor is a quarter as heavy as the bar.
    """
    spring = 3 * beam.stiffness / length**3
    return math.sqrt(spring / (3 / BARE[0] ** 4 * beam.mass * length + tip)) / math.tau


def _root(function: Callable[[float], float], low: float, high: float) -> float:
    """Where a function that changes its sign once between two values is 0: by bisection."""
    sign = math.copysign(1.0, function(low))
    for _ in range(STEPS):
        middle = (low + high) / 2
        low, high = (middle, high) if function(middle) * sign > 0 else (low, middle)
    return (low + high) / 2
