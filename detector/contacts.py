"""Possible contacts of a joint with the flanks of its teeth: impacts, and rests, in which the flank pushes the joint.

Both are found from the joint's acceleration alone; the play need not be known.  An impact is an impulse larger than
that of the command's acceleration; the bar's reaction on the joint makes impulses too, but their sum over a period of
the bar vanishes.  A rest is a run of steps in which the joint's acceleration, averaged over a period of the bar, is
that of the command and clearly not zero: in free flight it is zero.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lostmotion.detector.deconvolution import STEP, Inverse
from lostmotion.detector.window import FloatArray

__all__ = ["LEAST_PUSH", "Contacts", "averaged", "contacts"]

Mask = NDArray[np.bool_]
PERIOD = round(1 / STEP)
"""Steps of the grid in a period of the bar."""
LEAST_IMPULSE, SIGNIFICANT = 0.02, 6.0
"""Least change of the speed by an impact within three steps, in rad/s and in standard deviations."""
FRICTION = 2.0
"""Largest acceleration of a joint in flight by friction [rad/s²]."""
ABOVE_PUSH, CLEARLY_ABOVE = 1.2, 1.5
"""Least ratio of an impact to the impulse of the command's acceleration in three steps; the latter of a sure one."""
OF_LARGEST, CLEARLY_LARGE = 0.35, 0.6
"""Share of the largest impulse of the two periods before: smaller ones may be the bar's reaction to it."""
SUM_KEPT = 0.6
"""Share of an impact that its sum over a period keeps at least; the bar's reaction cancels."""
LEAST_PUSH = 5.0
"""Commanded acceleration [rad/s²] from which a rest is sure: more than friction."""
SAME, JOLT = 0.3, 0.8
"""Largest deviation from the command's acceleration in a rest, averaged over a period, and of three steps."""
CLOSE = 4
"""Steps about a jolt that are no rest."""
LEAST_RUN = 3
NOISE_OF_COMMAND = 0.7
"""Uncertainty of the commanded acceleration [rad/s²]."""


@dataclass(frozen=True, slots=True, eq=False)
class Contacts:
    """By step of the grid, shape (K,): impacts and sure ones; rests and possible extensions of them; the impulse of
    three steps [rad/s]; the commanded acceleration averaged over a period of the bar [rad/s²]."""

    impacts: Mask
    hard: Mask
    rests: Mask
    loose: Mask
    impulse: FloatArray
    push: FloatArray


def contacts(inverse: Inverse, impulses: FloatArray, commanded: FloatArray, known: Mask) -> Contacts:
    """Possible contacts; commanded: acceleration [rad/s²] at the grid's times, known: where there is one."""
    count, step = impulses.size, inverse.step
    inner = known.copy()
    inner[: PERIOD // 2] = inner[count - PERIOD // 2 :] = False
    moved, push = averaged(impulses) / step, averaged(commanded)
    impulse = np.convolve(impulses, np.ones(3), "same")
    size, driven = np.abs(impulse), 3 * step * (np.abs(push) + FRICTION)
    largest = size >= _highest(size, 3, 3)
    answer = _highest(size, 2 * PERIOD, 0)
    impacts = inner & largest & (size > LEAST_IMPULSE) & (size > SIGNIFICANT * inverse.deviation)
    impacts &= (PERIOD * step * moved * np.sign(impulse) > SUM_KEPT * size) & (size > ABOVE_PUSH * driven)
    impacts &= size > OF_LARGEST * answer
    hard = impacts & (size > CLEARLY_LARGE * answer) & (size > CLEARLY_ABOVE * driven)
    excess = np.abs(impulse - 3 * step * push)
    jolts = excess > np.maximum(5 * inverse.deviation, JOLT * 3 * step * np.abs(push))
    deviation = inverse.slow_deviation
    rests = inner & (np.abs(moved - push) < SAME * np.abs(push) + 1.5 * deviation) & ~_near(jolts, CLOSE)
    rests = _runs(rests & (np.abs(push) > np.maximum(6 * deviation, LEAST_PUSH)), LEAST_RUN)
    loose = inner & (np.abs(moved - push) < 2.5 * np.hypot(deviation, NOISE_OF_COMMAND))
    return Contacts(impacts, hard, rests, loose, impulse, push)


def averaged(values: FloatArray) -> FloatArray:
    """Averages over a period of the bar."""
    return np.convolve(values, np.ones(PERIOD) / PERIOD, "same")


def _highest(values: FloatArray, before: int, after: int) -> FloatArray:
    """Running maximum, over so many values before and after each."""
    padded = np.pad(values, (before, after))
    return np.asarray(np.lib.stride_tricks.sliding_window_view(padded, before + after + 1).max(axis=1))


def _near(mask: Mask, reach: int) -> Mask:
    return np.asarray(np.convolve(mask, np.ones(2 * reach + 1), "same") > 0.5)


def _runs(mask: Mask, least: int) -> Mask:
    """The runs of at least so many true values."""
    row = np.cumsum(np.concatenate([[True], mask[1:] != mask[:-1]]))
    return np.asarray(mask & (np.bincount(row)[row] >= least))
