"""Formats numbers for people: units with prefixes, angles in degrees, as many digits as the interval supports.

Files, messages and ``--json`` stay in SI units; only text and pictures for people use this module.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

__all__ = [
    "SMALLEST_P",
    "Interval",
    "Scale",
    "number",
    "of_axis",
    "quantities",
    "quantity",
    "raised",
    "readable",
    "scale",
    "with_unit",
]

SMALLEST = 0.1
"""The largest unit is taken in which the largest value is at least this; thousands (kN) are taken from 1 on."""
MOST_DIGITS = 6
"""Largest number of digits."""
SMALLEST_P = 0.003
"""Smaller probabilities are shown as a bound: one false name in 300 searches is the smallest rate that was counted."""

_SCALES: dict[str, tuple[tuple[str, float], ...]] = {
    "m": (("m", 1.0), ("mm", 1e3), ("µm", 1e6), ("nm", 1e9)),
    "s": (("s", 1.0), ("ms", 1e3), ("µs", 1e6)),
    "rad": (("°", 180 / math.pi), ("′", 10800 / math.pi), ("″", 648000 / math.pi)),
    "rad/s": (("°/s", 180 / math.pi),),
    "kg": (("kg", 1.0), ("g", 1e3), ("mg", 1e6)),
    "kg m^2": (("kg m²", 1.0), ("kg cm²", 1e4), ("g cm²", 1e7)),
    "N": (("kN", 1e-3), ("N", 1.0), ("mN", 1e3), ("µN", 1e6)),
    "N m": (("N m", 1.0), ("mN m", 1e3), ("µN m", 1e6)),
    "N m/rad": (("kN m/rad", 1e-3), ("N m/rad", 1.0), ("mN m/rad", 1e3)),
    "N m s/rad": (("N m s/rad", 1.0), ("mN m s/rad", 1e3), ("µN m s/rad", 1e6)),
    "N m s^2/rad^2": (("N m s²/rad²", 1.0), ("mN m s²/rad²", 1e3), ("µN m s²/rad²", 1e6)),
    "N/m": (("MN/m", 1e-6), ("kN/m", 1e-3), ("N/m", 1.0)),
    "N/m^3": (("N/mm³", 1e-9), ("MN/m³", 1e-6), ("kN/m³", 1e-3), ("N/m³", 1.0)),
    "N s/m": (("N s/m", 1.0), ("mN s/m", 1e3)),
    "m/s": (("m/s", 1.0), ("mm/s", 1e3), ("µm/s", 1e6)),
    "m/s^2": (("km/s²", 1e-3), ("m/s²", 1.0), ("mm/s²", 1e3)),
    "m/s^3": (("m/s² per second", 1.0), ("mm/s² per second", 1e3)),
    "Hz": (("kHz", 1e-3), ("Hz", 1.0)),
    "V": (("V", 1.0), ("mV", 1e3), ("µV", 1e6)),
    "A": (("A", 1.0), ("mA", 1e3)),
    "Ohm": (("Ω", 1.0), ("mΩ", 1e3)),
    "degC": (("°C", 1.0),),
    "%": (("%", 1.0), ("ppm", 1e4)),
}
_RAISED = str.maketrans("0123456789-", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻")


@dataclass(frozen=True, slots=True)
class Scale:
    """A unit for display, and the factor from SI to it."""

    unit: str
    factor: float


def scale(unit: str, *values: float) -> Scale:
    """The unit in which these SI values are read together; values that are not finite do not count."""
    known = _SCALES.get(unit)
    if known is None:
        return Scale(readable(unit), 1.0)
    largest = max((abs(v) for v in values if math.isfinite(v)), default=0.0)
    if largest == 0:
        return next(Scale(name, factor) for name, factor in known if factor >= 1)
    for name, factor in known:
        if largest * factor >= (1 if factor == 1e-3 else SMALLEST):
            return Scale(name, factor)
    return Scale(*known[-1])


def raised(exponent: str) -> str:
    """An exponent with raised digits: "⁻³" for "-3"."""
    return exponent.translate(_RAISED)


def readable(unit: str) -> str:
    """An SI unit with raised powers: "kg m^2" is "kg m²"."""
    head, *powers = unit.split("^")
    return head + "".join(raised(power[0]) + power[1:] for power in powers if power)


def number(value: float, decimals: int) -> str:
    """A number with that many decimals (negative ones round to tens), a true minus sign, powers of ten where needed."""
    if not math.isfinite(value):
        return "unknown" if math.isnan(value) else ("∞" if value > 0 else "−∞")
    rounded = round(value, decimals)
    if rounded and not 1e-4 <= abs(rounded) < 1e6:
        exponent = math.floor(math.log10(abs(rounded)))
        digits = min(max(exponent + decimals, 0), MOST_DIGITS)
        return f"{rounded / 10.0**exponent:.{digits}f} × 10{raised(str(exponent))}".replace("-", "−")
    return f"{rounded if rounded else 0.0:.{max(decimals, 0)}f}".replace("-", "−")


def quantities(unit: str, *values: float, digits: int = 2) -> tuple[tuple[str, ...], str]:
    """The values as text in one common unit, each to so many significant digits, and that unit."""
    chosen = scale(unit, *values)
    scaled = [value * chosen.factor for value in values]
    return tuple(number(v, max(_decimals(v, digits), 0)) for v in scaled), chosen.unit


def quantity(value: float, unit: str, digits: int = 3) -> str:
    """A value with its unit: "0.120 mN m"."""
    (text,), name = quantities(unit, value, digits=digits)
    return with_unit(text, name)


@dataclass(frozen=True, slots=True)
class Interval:
    """A value with its 95 % confidence interval, SI units; infinite or NaN ends are not known.

    ``str()`` gives "0.120 mN m, between 0.112 and 0.128 (95 %)": two digits of the interval's width, or one where the
    first is more than 3, so that the last digit shown is between a hundredth and a third of the width.
    """

    value: float
    low: float = math.nan
    high: float = math.nan
    unit: str = ""

    @property
    def known(self) -> bool:
        """Whether there is an interval."""
        return math.isfinite(self.low) and math.isfinite(self.high) and self.high > self.low

    @property
    def size(self) -> Interval:
        """The interval of the magnitude."""
        return self if self.value >= 0 else Interval(-self.value, -self.high, -self.low, self.unit)

    @property
    def percent(self) -> Interval:
        """A share as a percentage."""
        return Interval(100 * self.value, 100 * self.low, 100 * self.high, "%")

    @property
    def tilt(self) -> Interval:
        """A share as the angle whose sine it is."""
        value, low, high = (math.asin(min(max(v, -1.0), 1.0)) for v in (self.value, self.low, self.high))
        return Interval(value, low, high, "rad")

    @property
    def inverse(self) -> Interval:
        """The reciprocal; only for positive ratios."""
        low, high = (1 / v if v > 0 else math.inf for v in (self.high, self.low))
        return Interval(1 / self.value, low, high, self.unit)

    @property
    def alone(self) -> str:
        """The value and unit without the interval, rounded by it."""
        (value, *_), unit = self.texts()
        return with_unit(value, unit)

    def texts(self) -> tuple[tuple[str, str, str], str]:
        """value, low, high as numbers in one unit, and that unit; an unknown end is a dash."""
        chosen = scale(self.unit, self.value, self.low, self.high)
        value, low, high = (v * chosen.factor for v in (self.value, self.low, self.high))
        decimals = _decimals(value, 3)
        if self.known:
            width = high - low
            digits = 2 if f"{width:e}" < "3.55" else 1
            last = digits - 1 - math.floor(math.log10(width))  # of a width of 9.7 the units, not the tens
            decimals = min(last, _decimals(max(abs(low), abs(high)), MOST_DIGITS))
        elif self.unit == "" and self.value.is_integer():  # a number of teeth
            decimals = 0
        low_text, high_text = (number(v, decimals) if math.isfinite(v) else "–" for v in (low, high))
        return (number(value, decimals), low_text, high_text), chosen.unit

    def __str__(self) -> str:
        if not self.known:
            return self.alone
        (value, low, high), unit = self.texts()
        return f"{with_unit(value, unit)}, between {low} and {high} (95 %)"


def _decimals(value: float, digits: int) -> int:
    """Decimals that show this many digits of the value, after rounding."""
    if value == 0 or not math.isfinite(value):
        return 0
    return digits - 1 - math.floor(math.log10(float(f"{abs(value):.{digits - 1}e}")))


def with_unit(text: str, unit: str) -> str:
    """A number before its unit, with the space that belongs there."""
    if unit in ("", "°", "′", "″"):
        return text + unit
    return f"{text} {unit}"


def of_axis(unit: str, is_linear: bool, drive: str = "") -> str:
    """The unit of a quantity that has this unit on a joint with a torque: "N s/m" for "N m s/rad" on a linear axis, "A
    s/rad" where a current was recorded."""
    if drive:
        unit = unit.replace("kg m^2", f"{drive} s^2/rad").replace("N m", drive)
    elif is_linear:
        unit = unit.replace("kg m^2", "kg").replace("N m", "N")
    return unit.replace("rad", "m") if is_linear else unit
