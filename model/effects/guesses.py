"""Where a search for an effect begins: the scales of a motion, and grids of values.  No fitting here.

An effect's size is guessed from the motion (a friction from the torques, a stiffness from the deflections); what makes
valleys (a phase, a number of teeth, a frequency, a time) is laid out as a grid.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

__all__ = ["PHASES", "SMALL", "Guesses", "MotionScales", "Values", "grid", "no_guesses", "turns"]

Values = dict[str, float]
"""Of an effect's parameters by their names, or of the base's that move along with them."""


@dataclass(frozen=True)
class MotionScales:
    """Usual (root mean square) and largest magnitudes in a motion, SI units; zero where a base has none.

    torque on the joint, its speed, the span of its angle; the bar's deflection and speed; the usual and the largest
    reading; stiffness and damping of the bar, its natural frequency [Hz] and place of rest [m]; play; length of a
    record [s]; inertia; lines: frequencies [Hz] of the largest lines in the spectrum of the reading, the largest first;
    noise of the angle.
    """

    torque: float
    speed: float
    span: float
    bend: float
    swing: float
    reading: float
    peak: float
    k: float
    b: float
    d: float
    inertia: float
    length: float
    resonance: float = 0.0
    rest: float = 0.0
    lines: tuple[float, ...] = ()
    noise: float = 0.0


Guesses = Callable[[MotionScales], Sequence[Values]]
PHASES = (0.0, math.pi / 2, math.pi, -math.pi / 2)
SMALL = (0.015, 0.05, 0.15)
"""Shares of the usual torque that a friction may have."""


def no_guesses(scales: MotionScales) -> Sequence[Values]:
    """No guesses: the default of an effect."""
    return ()


def grid(**values: Sequence[float]) -> list[Values]:
    """All combinations."""
    return [dict(zip(values, each, strict=True)) for each in itertools.product(*values.values())]


def turns(scales: MotionScales, most: float) -> list[float]:
    """Numbers of periods a turn, up to this one, that differ over the span of angle by less than a tenth of a turn of
    the phase; beside a play, where fits begin again at other numbers, by a third of a turn.  With a third the number 4
    of a servo that moves by 1.7 rad was none of them, and a weight was named for its ripple."""
    step = min(max((2.0 if scales.d else 0.6) / max(scales.span, 1e-3), 1.0), 12.0)
    return [float(n) for n in np.unique(np.round(np.arange(1.0, most + 0.5, step)))]
