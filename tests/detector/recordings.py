"""Recordings of a healthy and of a worn joint under a hand-waved motion, in noise of several kinds."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from tests.detector.synthetic import HandWaved, quantise, ring

FloatArray = NDArray[np.float64]
NOISES = ("white", "coloured", "hum", "fan")
LENGTH_M, POLL_HZ, STEP = 0.1, 100.0, math.radians(300) / 1023


def noise(rng: np.random.Generator, kind: str, count: int, rate_hz: float) -> FloatArray:
    """Noise of about 0.2 m/s²: white; coloured: with a first-order part; hum: with mains at 50 Hz; fan: with a line
    that wanders about 63 Hz, beside the bar's 58 Hz."""
    time = np.arange(count) / rate_hz
    white = rng.normal(0, 0.2, count)
    if kind == "coloured":
        rho = 0.7 ** (200 / rate_hz)
        impulses = rng.normal(0, 0.3 * math.sqrt(1 - rho**2), count)
        slow = np.empty(count)
        state = 0.0
        for i, impulse in enumerate(impulses):
            slow[i] = state = rho * state + impulse
        return white + slow
    if kind == "hum":
        return np.asarray(white + 0.3 * np.sin(2 * math.pi * 50.02 * time + rng.uniform(0, 6)))
    if kind == "fan":
        wander = np.cumsum(rng.normal(0, 0.3 / math.sqrt(rate_hz), count))
        return np.asarray(white + 0.3 * np.sin(2 * math.pi * 63 * time + wander))
    return white


def moved(
    rng: np.random.Generator, seconds: float, rate_hz: float, kind: str, impact: float = 0.0
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Times and commands of a servo, times and tip acceleration, with rings of an amplitude [m/s²] after reversals."""
    motion = HandWaved.draw(rng, 0.5, 3.0, 0.15)
    polls, time = np.arange(0, seconds, 1 / POLL_HZ), np.arange(0, seconds, 1 / rate_hz)
    accel = LENGTH_M * motion.acceleration(time) + noise(rng, kind, time.size, rate_hz)
    if impact:
        for reversal in motion.reversals(seconds):
            first = reversal + rng.uniform(0.01, 0.08)
            near = slice(*np.searchsorted(time, (first - 0.01, first + 1.0)))
            size = impact * rng.uniform(0.5, 1.5)
            accel[near] += size * ring(time[near], np.array([first]), 58.0, 0.012)[0]
    return polls, quantise(motion.angle(polls), STEP), time, accel
