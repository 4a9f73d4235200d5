"""Elementary functions without branches and calls, so that lanes are computed by vector instructions.  No physics.

A polynomial is evaluated after a reduction of the argument (Muller, Elementary Functions, 2016, chapters 3 and 11).
Errors: 4e-16 of the result of tanh and exp; 3e-16 in sine and cosine of angles up to 1e15 rad.  Beyond 7e15 rad, where
neighbouring numbers are a radian apart, sine and cosine are undefined and may be larger than one.  The functions are
for kernels; those of the C library are called for one lane after the other.
"""

from __future__ import annotations

import math
from typing import Any

from llvmlite import ir
from numba import types

from lostmotion.model.kernel import jitted
from lostmotion.model.lanes import intrinsic_function

__all__ = ["cosine", "exponential", "sine", "tanh"]

ROUNDS = 6755399441055744.0
"""1.5 x 2^52: a number to which it is added is rounded to a whole one, which stands in the last bits of the sum."""
PER_LN2, LN2_HIGH, LN2_LOW = 1 / math.log(2), 0.6931471804855391, 7.440617110012397e-11
PER_PI = 1 / math.pi
PI_HIGH, PI_MIDDLE, PI_LOW = 3.141592651605606, 1.9841871479187034e-09, 1.1442377452219664e-17
E2, E3, E4, E5, E6, E7, E8, E9, E10, E11, E12, E13 = (1 / math.factorial(n) for n in range(2, 14))
E15, E17, E19, E21 = (1 / math.factorial(n) for n in range(15, 22, 2))
"""Coefficients of the series of exp."""
MOST = 700.0
"""Largest magnitude of the argument of an exponential; exp(±700) is 1e±304."""
ONE = 1023 << 52
"""The bits of 1.0; 2^k has k << 52 more."""


@intrinsic_function
def _bits(context: Any, number: Any) -> Any:
    """The bits of a number as an integer."""

    def codegen(_context: Any, builder: Any, _signature: Any, args: Any) -> Any:
        return builder.bitcast(args[0], ir.IntType(64))

    return types.int64(types.float64), codegen


@intrinsic_function
def _number(context: Any, bits: Any) -> Any:
    """The number with these bits."""

    def codegen(_context: Any, builder: Any, _signature: Any, args: Any) -> Any:
        return builder.bitcast(args[0], ir.DoubleType())

    return types.float64(types.int64), codegen


@jitted
def _parts(x: float) -> tuple[float, float]:
    """2^k and exp(r) - 1 with exp(x) = 2^k exp(r), |r| <= ln(2)/2."""
    x = -MOST if x < -MOST else x
    x = MOST if x > MOST else x
    rounded = x * PER_LN2 + ROUNDS
    k = rounded - ROUNDS
    r = (x - k * LN2_HIGH) - k * LN2_LOW
    series = E12 + r * E13
    series = E7 + r * (E8 + r * (E9 + r * (E10 + r * (E11 + r * series))))
    series = E2 + r * (E3 + r * (E4 + r * (E5 + r * (E6 + r * series))))
    return _number((_bits(rounded) << 52) + ONE), r + r * r * series


@jitted
def exponential(x: float) -> float:
    """exp(x); beyond ±700 that of ±700."""
    scale, more = _parts(x)
    return scale + scale * more


@jitted
def tanh(x: float) -> float:
    """tanh(x), exact to rounding also near zero."""
    scale, more = _parts(2 * x)
    less_one = scale * more + (scale - 1.0)  # exp(2 x) - 1
    return less_one / (less_one + 2.0)


@jitted
def _sine(r: float) -> float:
    """sin(r) for |r| <= pi/2."""
    x = r * r
    series = E13 - x * (E15 - x * (E17 - x * (E19 - x * E21)))
    series = E3 - x * (E5 - x * (E7 - x * (E9 - x * (E11 - x * series))))
    return r - r * x * series


@jitted
def _turned(rounded: float, r: float) -> float:
    """sin(r + k pi), k being the whole number in ``rounded``."""
    return float(_number(_bits(_sine(r)) ^ (_bits(rounded) << 63)))


@jitted
def sine(x: float) -> float:
    """sin(x)."""
    rounded = x * PER_PI + ROUNDS
    k = rounded - ROUNDS
    return _turned(rounded, ((x - k * PI_HIGH) - k * PI_MIDDLE) - k * PI_LOW)


@jitted
def cosine(x: float) -> float:
    """cos(x)."""
    rounded = x * PER_PI + 0.5 + ROUNDS
    k = rounded - ROUNDS - 0.5
    return _turned(rounded, ((x - k * PI_HIGH) - k * PI_MIDDLE) - k * PI_LOW)
