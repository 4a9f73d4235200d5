"""What cannot be estimated at a rate, or with such a window or commands: one sentence with numbers, "" if all can.

For ``config check`` and ``doctor``.  Where scoring is impossible, ``score.validate`` raises an error instead.
"""

from __future__ import annotations

import math
from dataclasses import replace

from lostmotion.detector.play_size import LEAST_RATE
from lostmotion.detector.window import DetectorSettings
from lostmotion.detector.windows import IMPACT_DELAY, window_length

__all__ = ["poll_limit", "rate_limit", "window_limit"]

LEAST_ENERGY = 0.5
"""Share of a ring-down's energy that a window should hold: half of it is 3 dB."""
POLLS_A_PERIOD, WAVED_HZ = 10.0, 3.0
"""Commands a period of the motion with which 97 to 100 % of its reversals are found (with 8: 92 to 95 %, 6.7: 84 %, 5:
52 %; ``tests/detector/choices.py``), and the fastest usual motion of an arm [Hz]."""


def rate_limit(f_res_hz: float, rate_hz: float, what: str) -> str:
    """Whether a sensor at rate_hz is too slow to resolve single impacts; what: the quantities estimated from them."""
    if rate_hz >= LEAST_RATE * f_res_hz:
        return ""
    return (
        f"{what} cannot be estimated: found {rate_hz / f_res_hz:.1f} samples a period of the bar ({rate_hz:g} Hz, "
        f"bar of {f_res_hz:g} Hz), expected at least {LEAST_RATE:g}: "
        f"take a sensor of {LEAST_RATE * f_res_hz:g} Hz or faster, "
        f"or a bar of {rate_hz / LEAST_RATE:g} Hz or slower"
    )


def window_limit(settings: DetectorSettings, rate_hz: float) -> str:
    """Whether the window ends long before a ring-down does, which begins when the teeth usually strike: it holds the
    share 1 - exp(-2 (T - delay) / tau) of its energy, tau = 1 / (2π zeta f_res)."""
    length, tau = window_length(settings, rate_hz), 1 / (2 * math.pi * settings.zeta * settings.f_res_hz)
    held = -math.expm1(-2 * max(length - IMPACT_DELAY, 0.0) / tau)
    if held >= LEAST_ENERGY:
        return ""
    auto = window_length(replace(settings, window_s=None), rate_hz)
    change = f'window_s = "auto" makes it {auto:.2g} s' if auto > length else "take a bar whose ring is shorter"
    return (
        f"weak impacts are missed: a window of {length:.2g} s holds {held:.0%} of the energy of a ring-down "
        f"(time constant {tau:.2g} s), expected at least {LEAST_ENERGY:.0%}: {change}"
    )


def poll_limit(poll_hz: float) -> str:
    """Whether commands are too infrequent to find the reversals of a usual motion, and to interpolate it."""
    needed = POLLS_A_PERIOD * WAVED_HZ
    if poll_hz >= needed:
        return ""
    return (
        f"reversals of motions above {poll_hz / POLLS_A_PERIOD:.2g} Hz are missed, and the size of the play cannot be "
        f"estimated: found {poll_hz:g} commands a second, expected {needed:g} or more"
    )
