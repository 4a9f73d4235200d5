"""Recordings of gears that the bench's own simulator moves, for tests of the lab's search."""

from __future__ import annotations

import math

import numpy as np
from bench.hidden_effects.motion import hand_waved
from bench.hidden_effects.physics import follow, simulate

from lostmotion.drivers.recording import Recording

__all__ = ["GEARS", "gears"]

GEARS = {"d": 8e-5, "alpha": 4000.0, "b": 0.18, "k": 2600.0}
NOISE, LEAD, LENGTH = 0.2, 0.5, 2.0


def gears(seed: int, largest: float = math.inf, **hidden: float) -> Recording:
    """The accelerometer of gears with something hidden, begun in motion, with noise; largest: its range [m/s²]."""
    rng = np.random.default_rng(seed)
    command, values = hand_waved(rng, LEAD + LENGTH), {**GEARS, **hidden}
    times = LEAD + np.arange(round(LENGTH * 800)) / 800
    accel = simulate(values, command, np.concatenate(([0.0], times)), follow(values, command, 0.0))[0][1:]
    reading = np.clip(accel + rng.normal(0, NOISE, times.size), -largest, largest)
    return Recording(times - LEAD, {"command": command.at(times), "accel": reading}, name=f"rec{seed}.csv")
