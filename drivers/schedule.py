"""How a simulated robot's time passes: in steps of stretches of motion, with rest between them.

Pure functions of numbers: no physics, no waiting.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from lostmotion.drivers.base import FloatArray

__all__ = ["YEAR_S", "Step", "grid", "schedule_step", "skips"]

YEAR_S = 365 * 86400.0

STRETCH_S = 4.0
"""Motion in one stretch where time is skipped [s]: some fifteen reversals."""
STRETCH_EVERY_S = 1.0
"""Real time from the start of one such stretch to that of the next [s]."""
SHIFT_S = 3600.0
"""Motion in one stretch where time is not skipped [s]; then the robot rests for a second."""
REST_S = 1.0
TAIL_S = 0.5
"""The servos fall silent this long before the end of a stretch [s], so that the last window is complete."""


@dataclass(frozen=True, slots=True)
class Step:
    """A step of robot time [s]: from begin to end the accelerometers deliver samples, until servo_end the servos.

    It is part of the stretch number ``stretch``, which began at ``origin``; ``after_rest``: it is the first one there.
    """

    stretch: int
    origin: float
    begin: float
    end: float
    servo_end: float

    @property
    def after_rest(self) -> bool:
        """Whether the robot has rested before this step."""
        return self.begin == self.origin


def skips(speed: float) -> bool:
    """Whether robot time runs so fast that most of it is rest; at speed inf nothing is skipped."""
    return STRETCH_S / STRETCH_EVERY_S < speed < math.inf


def schedule_step(number: int, length: float, speed: float) -> Step:
    """Step ``number`` of the schedule at that speed, each of ``length`` [s], a whole part of a stretch."""
    motion, every = (STRETCH_S, speed * STRETCH_EVERY_S) if skips(speed) else (SHIFT_S, SHIFT_S + REST_S)
    stretch, part = divmod(number, round(motion / length))
    origin = stretch * every
    end = origin + (part + 1) * length
    return Step(stretch, origin, origin + part * length, end, min(end, origin + motion - TAIL_S))


def grid(begin: float, end: float, rate_hz: float) -> FloatArray:
    """The multiples of 1 / rate_hz in [begin, end) [s]."""
    first, last = (math.ceil(edge * rate_hz - 1e-6) for edge in (begin, end))
    return np.arange(first, last) / rate_hz
