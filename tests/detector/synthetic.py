"""Signals to measure the detector with: hand-waved motions, windows with and without impacts.

Independent of ``lostmotion.model``: sums of sines, decaying sines and coloured noise, with everything known exactly.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class HandWaved:
    """theta(t) = sum a sin(2π f t + phi): irregular, smooth, band-limited, with exact derivatives."""

    amplitude: FloatArray
    frequency: FloatArray
    phase: FloatArray

    @classmethod
    def draw(cls, rng: np.random.Generator, low_hz: float, high_hz: float, rms_rad: float) -> HandWaved:
        """Five sines between two frequencies, of equal speed, scaled to an rms angle."""
        frequency = rng.uniform(low_hz, high_hz, 5)
        amplitude = rng.uniform(0.5, 1.0, 5) / frequency
        amplitude *= rms_rad / math.sqrt(float(np.sum(amplitude**2)) / 2)
        return cls(amplitude, frequency, rng.uniform(0, 2 * math.pi, 5))

    def angle(self, time: FloatArray) -> FloatArray:
        """theta [rad] at the times [s]."""
        return self._sum(time, 0)

    def acceleration(self, time: FloatArray) -> FloatArray:
        """theta'' [rad/s²] at the times [s]."""
        return self._sum(time, 2)

    def reversals(self, duration: float, least: float = 0.0) -> FloatArray:
        """Times [s] of the zero crossings of theta'' between lobes that both reach ``least`` [rad/s²]."""
        time = np.arange(0, duration, 1e-3)
        accel = self.acceleration(time)
        ends = np.flatnonzero(np.diff(np.sign(accel)) != 0)
        crossing = time[ends] - accel[ends] * 1e-3 / (accel[ends + 1] - accel[ends])
        peak = np.array([np.abs(lobe).max() for lobe in np.split(accel, ends + 1)])
        return crossing[(peak[:-1] >= least) & (peak[1:] >= least)]

    def _sum(self, time: FloatArray, order: int) -> FloatArray:
        omega = 2 * math.pi * self.frequency[:, None]
        sines = np.sin(omega * time + self.phase[:, None] + order * math.pi / 2)
        return np.asarray(np.sum(self.amplitude[:, None] * omega**order * sines, axis=0))


def quantise(angle: FloatArray, step: float) -> FloatArray:
    """The angle as measured by an encoder of that step; a step of 0 changes nothing."""
    return angle if step == 0 else np.round(angle / step) * step


def ring(
    time: FloatArray, start: FloatArray, f_res_hz: float, zeta: float, phase: float | FloatArray = 0.0
) -> FloatArray:
    """Ring-downs of unit amplitude from each start [s]; shape (len(start), len(time))."""
    after = time - start[:, None]
    omega = 2 * math.pi * f_res_hz
    decay = np.exp(-zeta * omega * np.maximum(after, 0))
    return np.where(after >= 0, decay * np.sin(omega * math.sqrt(1 - zeta**2) * after + phase), 0.0)


@dataclass(frozen=True)
class Scene:
    """What stands around the impacts; amplitudes in units of the white noise's standard deviation."""

    f_res_hz: float = 58.0
    zeta: float = 0.012
    motion: float = 20.0  # acceleration of the moving tip, 0.5-3 Hz
    gravity: float = 20.0  # gravity leaking in as the joint turns
    coloured: float = 1.0  # AR(1) noise with coefficient 0.7 at 200 Hz (motor, cables, structure)
    shaken: float = 0.3  # the bar shaken by a rough but tight gear
    impact: float = 6.0  # median amplitude of the ring-down; log-normal by a factor of 1.6

    def healthy(self, rng: np.random.Generator, count: int, rate_hz: float, duration: float) -> FloatArray:
        """Windows of a joint without play, shape (count, N)."""
        time = np.arange(round(duration * rate_hz)) / rate_hz
        frequency = rng.uniform(0.5, 3.0, (count, 1))
        moving = self.motion * rng.uniform(0.2, 1.0, (count, 1)) * np.sin(2 * math.pi * frequency * time)
        tilt = np.sin(2 * math.pi * frequency * time + rng.uniform(0, 2 * math.pi, (count, 1)))
        leak = self.gravity * rng.uniform(0, 1, (count, 1)) * tilt + rng.normal(0, 20, (count, 1))
        noise = rng.normal(size=(count, time.size)) + self.coloured * _ar1(rng, count, time.size, rate_hz)
        return moving + leak + noise + self.shaken * _resonant(rng, count, time, self.f_res_hz, self.zeta)

    def worn(self, rng: np.random.Generator, count: int, rate_hz: float, duration: float) -> FloatArray:
        """Windows with an impact 5-90 ms after the reversal, a rebound, and the rest of the ring before."""
        base = self.healthy(rng, count, rate_hz, duration)
        time = np.arange(base.shape[1]) / rate_hz
        size = self.impact * np.exp(rng.normal(0, math.log(1.6), (count, 1)))
        first = rng.uniform(0.005, 0.090, count)
        real = self.f_res_hz + rng.normal(0, 0.5)  # the setting is never quite right
        hits = ring(time, first, real, self.zeta)
        hits -= rng.uniform(0.1, 0.5, (count, 1)) * ring(time, first + rng.uniform(0.01, 0.06, count), real, self.zeta)
        hits += 0.2 * ring(time, np.zeros(count), real, self.zeta, float(rng.uniform(0, 6)))
        return np.asarray(base + size * hits)


def _ar1(rng: np.random.Generator, count: int, length: int, rate_hz: float) -> FloatArray:
    """First-order noise of unit variance whose corner does not depend on the sampling rate."""
    rho = 0.7 ** (200 / rate_hz)
    out = rng.normal(size=(count, length))
    for i in range(1, length):
        out[:, i] = rho * out[:, i - 1] + math.sqrt(1 - rho**2) * out[:, i]
    return out


def _resonant(rng: np.random.Generator, count: int, time: FloatArray, f_res_hz: float, zeta: float) -> FloatArray:
    """The oscillator shaken by white noise, of unit variance: narrow-band noise around its resonance."""
    rate = 1 / (time[1] - time[0])
    damping = math.exp(-2 * math.pi * zeta * f_res_hz / rate)
    turn = damping * np.exp(2j * math.pi * f_res_hz / rate)
    state = rng.normal(size=count) + 1j * rng.normal(size=count)
    out = np.empty((count, time.size))
    for i in range(time.size):
        impulse = rng.normal(size=count) + 1j * rng.normal(size=count)
        state = turn * state + math.sqrt(1 - damping**2) * impulse
        out[:, i] = state.real
    return out
