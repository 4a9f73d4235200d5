"""Hand-waved motion of the bench's own: a few incommensurate swings whose tempo wanders."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicSpline, PchipInterpolator

from bench.hidden_effects.physics import Command

__all__ = ["hand_waved"]

STEP = 5e-4
BEFORE = 0.5
"""Known this long before t = 0 [s], for commands that arrive late."""


def hand_waved(rng: np.random.Generator, duration: float) -> Command:
    """Seven swings between 0.5 and 3 Hz, 0.1 to 0.2 rad in all, for `duration` s from t = 0 on."""
    times = np.arange(-BEFORE, duration + 0.1, STEP)
    tempo = _tempo(rng, times)
    own_time = np.concatenate(([0.0], np.cumsum((tempo[1:] + tempo[:-1]) / 2 * STEP)))
    frequency = np.exp(rng.uniform(np.log(0.5), np.log(3.0), 7))
    size = rng.uniform(0.4, 1.0, 7) / frequency**0.8
    size *= rng.uniform(0.1, 0.2) / np.linalg.norm(size)
    swings = size * np.sin(2 * np.pi * np.outer(own_time, frequency) + rng.uniform(0, 2 * np.pi, 7))
    spline = CubicSpline(times, swings.sum(axis=1))
    return Command(-BEFORE, STEP, spline.c.T)


def _tempo(rng: np.random.Generator, times: np.ndarray) -> np.ndarray:
    """A random walk around 1, drawn back to it, smooth between its steps of 0.3 s."""
    knots = np.arange(times[0] - 0.3, times[-1] + 0.6, 0.3)
    walk = np.zeros(knots.size)
    for i in range(1, knots.size):
        walk[i] = 0.8 * walk[i - 1] + rng.normal(0.0, 0.15)
    return np.asarray(np.exp(PchipInterpolator(knots, walk)(times)))
