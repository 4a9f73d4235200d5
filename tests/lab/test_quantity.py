"""Numbers as a person reads them: units, digits by the interval, odd cases."""

from __future__ import annotations

import math

import pytest

from lostmotion.lab.quantity import Interval, number, quantities, quantity, scale


@pytest.mark.parametrize(
    ("given", "text"),
    [
        ((1.2e-4, 1.12e-4, 1.28e-4, "N m"), "0.120 mN m, between 0.112 and 0.128 (95 %)"),
        ((6e-5, 5.98e-5, 6.03e-5, "m"), "60.0 µm, between 59.8 and 60.3 (95 %)"),
        ((4.2e-3, 4.0e-3, 4.4e-3, "s"), "4.2 ms, between 4.0 and 4.4 (95 %)"),
        ((2e9, 1.7e9, 2.4e9, "N/m^3"), "2.0 N/mm³, between 1.7 and 2.4 (95 %)"),
        ((2656.0, 2500.0, 2800.0, "N/m"), "2.66 kN/m, between 2.50 and 2.80 (95 %)"),
        ((1980.0, 1500.0, 2500.0, "N s/m"), "2000 N s/m, between 1500 and 2500 (95 %)"),
        ((-0.3, -0.32, -0.29, "rad"), "−17.2°, between −18.3 and −16.6 (95 %)"),
        ((0.02, -1.0, 1.0, "rad/s"), "0 °/s, between −60 and 60 (95 %)"),
        ((58.03, 58.01, 58.05, "Hz"), "58.03 Hz, between 58.01 and 58.05 (95 %)"),
        ((12.0, math.nan, math.nan, ""), "12"),
        ((5.0, -math.inf, math.inf, "Hz"), "5.00 Hz"),
        ((0.0, 0.0, 0.0, "m"), "0 m"),
        ((1.0, 1.0 - 1e-12, 1.0 + 1e-12, "m"), "1.00000 m, between 1.00000 and 1.00000 (95 %)"),
    ],
)
def test_as_many_digits_as_the_interval_supports(given: tuple[float, float, float, str], text: str) -> None:
    """The unit suits the size, the digits the width of the interval; without an interval three digits stand alone."""
    assert str(Interval(*given)) == text


def test_derived_intervals_keep_their_order() -> None:
    """Size, tilt, percentage and inverse of an interval have their lower end first and hold the value."""
    skew = Interval(-1e-3, -1.1e-3, -0.9e-3)
    assert str(skew.size.percent) == "0.100 %, between 0.090 and 0.110 (95 %)"
    assert str(Interval(0.5, 0.4, 0.6).tilt) == "30°, between 24 and 37 (95 %)"
    inverse = Interval(0.5, 0.4, 0.625).inverse
    assert (inverse.low, inverse.value, inverse.high) == (1.6, 2.0, 2.5)
    assert not Interval(0.5, -0.1, 1.1).inverse.known


def test_several_values_share_one_unit() -> None:
    """An error and its noise are read in the unit of the larger, each to two digits; what is unknown is called so."""
    assert quantities("m/s^2", 4.1234, 0.4123, 0.4) == (("4.1", "0.41", "0.40"), "m/s²")
    assert quantities("V", 0.015, 0.00098) == (("15", "0.98"), "mV")
    assert quantities("rad", 1e-3, math.nan) == (("3.4", "unknown"), "′")


@pytest.mark.parametrize(
    ("value", "unit", "text"),
    [(3.45e-5, "N m", "34.5 µN m"), (250.0, "N", "250 N"), (2500.0, "N", "2.50 kN"), (2e-5, "%", "0.200 ppm"),
     (3e-6, "1/rad", "3.00 × 10⁻⁶ 1/rad"), (0.0, "m", "0 m"), (2e-4, "kg m^2", "2.00 kg cm²"),
     (7.0, "lbf", "7.00 lbf")],
)  # fmt: skip
def test_units_that_people_use(value: float, unit: str, text: str) -> None:
    """Prefixes where they help, powers of ten where no prefix is known, foreign units as they are."""
    assert quantity(value, unit) == text


def test_numbers_beyond_all_digits() -> None:
    """Infinite, missing and negative-zero numbers are written as a person would."""
    assert [number(v, 1) for v in (math.inf, -math.inf, math.nan, -0.0, -2.0)] == ["∞", "−∞", "unknown", "0.0", "−2.0"]
    assert number(1234567.0, -3) == "1.235 × 10⁶"
    assert number(12345.0, -2) == "12300"


def test_scale_of_nothing_is_the_si_unit() -> None:
    """Zero and values that are not finite choose no prefix."""
    assert scale("N m", 0.0, math.nan).unit == "N m"
    assert scale("N", 0.0).unit == "N"
