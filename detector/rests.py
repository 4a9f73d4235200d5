"""How a servo follows, from where its joint rests on a flank of its teeth: there it moves exactly as its gear does.

A dead joint with a large play is late, too: by the time in which it crosses the gap.  The angle alone takes that for a
servo that lags.  The acceleration does not: on a flank it is the gear's, in flight nearly none, and either is smooth,
where teeth strike or bounce it is not.  No play, no angles here.
"""

from __future__ import annotations

import numpy as np

from lostmotion.detector.commanded import Commanded
from lostmotion.detector.contacts import PERIOD, averaged
from lostmotion.detector.deconvolution import inverse, noise_of
from lostmotion.detector.servo import DELAYS, GRID_S, delayed
from lostmotion.detector.window import DetectorSettings, FloatArray, Window

__all__ = ["rested"]

QUIET = 8.0
"""Acceleration of three steps of the grid, beside that of a period of the bar, from which teeth strike [rad/s²]: less
than a blow of 0.06 rad/s."""
CLOSE = 4
"""Steps about a blow that tell nothing."""
WRONG, SHARE = 1.0, 0.1
"""Standard deviation of the commanded acceleration [rad/s²] and as a share of it: commands in steps of 5 mrad."""
DRAG, ELSE, RARE = 1.5, 40.0, 0.15
"""Standard deviations of the acceleration in flight, by friction, and of any other, with the latter's share [rad/s²].
"""
SHARES: FloatArray = np.array([0.02, 0.1, 0.25, 0.5, 0.75, 0.95])[:, None, None]
"""Shares of the time that a joint may rest: one that bounces does not, and tells nothing."""
WEIGHT = 0.5
"""Of a period of the bar: errors of the commanded acceleration are alike over some of them."""
OTHER = 0.15
"""Share of what following changes by which a servo follows otherwise than in any of the ways."""
THIN, LEAST = 3, 4


def rested(stretch: Window, command: Commanded, settings: DetectorSettings) -> FloatArray:
    """Log-likelihood of each way of following, shape (G,); 0 where the joint is never quiet."""
    undone = inverse(stretch.accel.size, stretch.rate_hz, noise_of(stretch.accel, settings), settings)
    impulses = undone.impulses(stretch.accel - stretch.accel.mean())
    moved, sharp = averaged(impulses) / undone.step, np.convolve(impulses, np.ones(3), "same") / (3 * undone.step)
    struck = np.abs(sharp - moved) > np.maximum(5 * undone.deviation / (3 * undone.step), QUIET)
    quiet = (np.convolve(struck, np.ones(2 * CLOSE + 1), "same") < 0.5) & (undone.times < command.end)
    quiet[:PERIOD] = quiet[-PERIOD:] = False
    quiet &= np.arange(quiet.size) % THIN == 0
    if quiet.sum() < LEAST:
        return np.zeros(DELAYS.size)
    grid = np.arange(command.start, command.end, GRID_S)
    ways = delayed(command.acceleration(grid), np.arange(DELAYS.size))
    place = np.rint((undone.times[quiet] - command.start) / GRID_S).astype(np.intp)
    push, moved, noise = ways[:, np.minimum(place, grid.size - 1)], moved[quiet], undone.slow_deviation[quiet] ** 2
    flies = (1 - RARE) * _normal(moved, noise + DRAG**2) + RARE * _normal(moved, noise + ELSE**2)
    rests = _normal(moved - push, noise + WRONG**2 + (SHARE * push) ** 2 + (OTHER * (push - push[0])) ** 2)
    told = np.log(SHARES * rests + (1 - SHARES) * flies).sum(axis=2) * (THIN / PERIOD)
    return np.asarray(WEIGHT * np.logaddexp.reduce(told, axis=0))


def _normal(x: FloatArray, variance: FloatArray) -> FloatArray:
    return np.asarray(np.exp(-(x**2) / variance / 2) / np.sqrt(variance))
