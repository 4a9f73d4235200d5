"""Units that recordings come in, and their factors to SI.  Only the table and its look-up."""

from __future__ import annotations

import math

__all__ = ["ARC_MINUTES", "COLUMN_UNITS", "MANY_TURNS", "STANDARD_GRAVITY", "to_si"]

COLUMN_UNITS = {
    "time": "s",
    "command": "rad",
    "position": "rad",
    "accel": "m/s^2",
    "torque": "N m",
    "force": "N",
    "displacement": "m",
    "voltage": "V",
    "current": "A",
    "temperature": "degC",
}
"""The columns of a recording that have a meaning, each with its unit."""

ARC_MINUTES = 60 * 180 / math.pi
"""in a radian"""
MANY_TURNS = 4 * math.pi
"""Angles beyond are doubted where no unit is known [rad]."""
POUND_FORCE = 4.4482216152605
"""[N], exact by definition, as is"""
STANDARD_GRAVITY = 9.80665
"""[m/s²]"""

_FACTORS: dict[str, dict[str, float]] = {
    "s": {"ms": 1e-3, "us": 1e-6, "µs": 1e-6, "ns": 1e-9, "min": 60.0, "h": 3600.0},
    "rad": {"mrad": 1e-3, "deg": math.pi / 180, "°": math.pi / 180, "arcmin": 1 / ARC_MINUTES, "rev": 2 * math.pi},
    "rad/s": {"deg/s": math.pi / 180, "°/s": math.pi / 180, "rpm": math.pi / 30, "rev/s": 2 * math.pi},
    "m/s": {"mm/s": 1e-3, "cm/s": 1e-2},
    "m/s^2": {"m/s²": 1.0, "mm/s^2": 1e-3, "g": STANDARD_GRAVITY, "mg": STANDARD_GRAVITY / 1000},
    "N m": {
        "Nm": 1.0, "N mm": 1e-3, "mN m": 1e-3, "N cm": 1e-2, "kN m": 1e3, "kgf cm": STANDARD_GRAVITY / 100,
        "lbf in": POUND_FORCE * 0.0254,
    },
    "N": {"mN": 1e-3, "kN": 1e3, "lbf": POUND_FORCE, "kip": 1000 * POUND_FORCE, "kgf": STANDARD_GRAVITY},
    "m": {"km": 1e3, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "µm": 1e-6, "in": 0.0254, "ft": 0.3048},
    "V": {"mV": 1e-3},
    "A": {"mA": 1e-3},
    "degC": {"°C": 1.0, "C": 1.0},
}  # fmt: skip


def to_si(unit: str) -> tuple[str, float] | None:
    """The SI unit that stands for ``unit`` and the factor to it; None where the unit is not known."""
    for si, others in _FACTORS.items():
        if unit == si:
            return si, 1.0
        if unit in others:
            return si, others[unit]
    return None
