"""Recordings of gears that the bench's own simulator moves, for tests of the lab's search."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from bench.hidden_effects.motion import Command, hand_waved
from bench.hidden_effects.physics import follow, simulate

from lostmotion.drivers.recording import Recording
from lostmotion.model.motion import FloatArray

__all__ = ["GEARS", "LEAD", "LENGTH", "NOISE", "RATE_HZ", "Moved", "gears", "moved"]

GEARS = {"d": 8e-5, "alpha": 4000.0, "b": 0.18, "k": 2600.0}
NOISE, LEAD, LENGTH, RATE_HZ = 0.2, 0.5, 2.0, 800.0


@dataclass(frozen=True, eq=False)
class Moved:
    """Gears in motion: seconds since LEAD after they began (N,), what the bar's end felt [m/s²], the states (N, n)."""

    time: FloatArray
    command: Command
    accel: FloatArray
    states: FloatArray
    random: np.random.Generator

    @property
    def noise(self) -> FloatArray:
        """White noise, of root mean square 1 (N,)."""
        return self.random.normal(0, 1.0, self.time.size)

    def recording(self, reading: FloatArray, name: str = "") -> Recording:
        """The command and what a sensor has read [m/s²]."""
        return Recording(self.time, {"command": self.command.at(self.time + LEAD), "accel": reading}, name=name)


def moved(seed: int, length: float = LENGTH, **hidden: float) -> Moved:
    """Gears with something hidden, waved by hand and long enough in motion."""
    random = np.random.default_rng(seed)
    command, values = hand_waved(random, LEAD + length), {**GEARS, **hidden}
    time = np.arange(round(length * RATE_HZ)) / RATE_HZ
    accel, states = simulate(values, command, np.concatenate(([0.0], LEAD + time)), follow(values, command, 0.0))
    return Moved(time, command, accel[1:], states[1:], random)


def gears(seed: int, length: float = LENGTH, largest: float = math.inf, **hidden: float) -> Recording:
    """The accelerometer of such gears; largest: its range [m/s²]."""
    run = moved(seed, length, **hidden)
    return run.recording(np.clip(run.accel + NOISE * run.noise, -largest, largest), f"rec{seed}.csv")
