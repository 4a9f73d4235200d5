"""What an accelerometer (or any sampled sensor) makes of a signal: noise, range, resolution.  A chain after the motion.

Effects on the sensor that depend on the motion or have a memory (filter, tilt, drift) are effects, not here.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from lostmotion.model.errors import ModelError
from lostmotion.model.motion import FloatArray

__all__ = ["Sensor"]


@dataclass(frozen=True)
class Sensor:
    """noise: standard deviation of the noise; noise_colour: correlation of a noise sample with the one before it
    (0 white, towards 1 red; the standard deviation stays); range: readings are clipped at ± this; resolution: size of
    one count, 0 for none.  All but the colour in the unit of the signal."""

    noise: float = 0.0
    resolution: float = 0.0
    range: float = math.inf
    noise_colour: float = 0.0

    def __post_init__(self) -> None:
        if not (0 <= self.noise < math.inf and 0 <= self.resolution < math.inf and self.range > 0):
            raise ModelError(f"noise and resolution cannot be negative nor the range 0: {self}")
        if not 0 <= self.noise_colour < 1:
            raise ModelError(f"noise_colour is a correlation from 0 to below 1, not {self.noise_colour:g}")

    def apply(self, values: FloatArray, rng: np.random.Generator) -> FloatArray:
        """The readings for true values (N,), in the order of a real sensor: noise, then range, then counts."""
        readings = np.clip(values + self._noise(np.shape(values)[0], rng), -self.range, self.range)
        return np.round(readings / self.resolution) * self.resolution if self.resolution else readings

    def _noise(self, size: int, rng: np.random.Generator) -> FloatArray:
        white = rng.normal(0.0, 1.0, size) * self.noise
        if self.noise_colour == 0 or size == 0:
            return white
        from scipy.signal import lfilter  # late: most sensors are white, and scipy.signal is heavy

        keep = math.sqrt(1 - self.noise_colour**2)
        return np.asarray(lfilter([keep], [1, -self.noise_colour], white, zi=[self.noise_colour * white[0]])[0])
