"""The sine of an unknown signal that explains most of the prediction error of observers.

describe.py asks it for the frequency of a sine before it fits one.
"""

from __future__ import annotations

import math

import numpy as np

from lostmotion.lab.deadline import is_over
from lostmotion.lab.discrepancy.basis import wave_guess
from lostmotion.lab.observer.filter import TIGHT
from lostmotion.lab.observer.objective import OUTSIDE, Follower, settled
from lostmotion.model import Model
from lostmotion.model.effects.registry import registered
from lostmotion.model.motion import FloatArray
from lostmotion.model.signals import TORQUE

__all__ = ["best_wave"]

FAINT = 1e-6
"""Amplitude of a sine at which its influence is computed to first order [N m]."""
SLOWEST_HZ, FASTEST_HZ, FASTEST = 1.0, 30.0, 0.45
"""Frequencies of sines: the lowest one, the highest one of a torque [Hz], and the highest one of a sensor as a share of
its rate."""


def best_wave(model: Model, follower: Follower, target: int) -> float:
    """The frequency [Hz] of the sine on a signal (target) that, to first order, explains most of the innovations of
    observers with a high gain, with the other parameters unchanged.

    A sine of the sensor is assumed to appear in the innovations with its frequency and any amplitude and phase.
    """
    fastest = FASTEST_HZ if target == TORQUE else FASTEST * follower.segments[0].rate_hz
    (e,) = follower.errors([model], TIGHT)
    weight = 1 / (1 + (e / OUTSIDE) ** 2)
    best, found = -1.0, SLOWEST_HZ
    for hz in np.arange(SLOWEST_HZ, fastest, 0.5 / min(s.duration for s in follower.segments)):
        if is_over():
            break
        J = _torque_wave(model, follower, float(hz), e) if target == TORQUE else _sensor_wave(follower, float(hz))
        if not np.isfinite(J).all():
            continue
        g = (J * weight[:, None]).T @ e
        gained = float(g @ np.linalg.lstsq((J * weight[:, None]).T @ J, g, rcond=1e-12)[0])
        best, found = max((best, found), (gained, float(hz)))
    return found


def _torque_wave(model: Model, follower: Follower, hz: float, e: FloatArray) -> FloatArray:
    """The change of the innovations (N, 2) by small amplitudes of a sine and a cosine of torque."""
    guess = wave_guess(model.base, TORQUE, hz, 1.0)
    with registered([guess.effect]):
        own = model.with_effect(guess.effect.id)
        moved = follower.errors([own.replace({f"{guess.effect.id}.{part}": FAINT}) for part in "ab"], TIGHT)
    return np.asarray((moved - e).T)


def _sensor_wave(follower: Follower, hz: float) -> FloatArray:
    """Sine and cosine at the times of the innovations (N, 2)."""
    time = np.concatenate([segment.time[settled(segment)] for segment in follower.segments])
    return np.column_stack([np.sin(2 * math.pi * hz * time), np.cos(2 * math.pi * hz * time)])
