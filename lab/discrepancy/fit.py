"""Local minimisation of the prediction error of observers over many small parameters at once.

With a high observer gain the prediction error is nearly linear in the parameters, so that a curve with a dozen values
can be fitted from zero, together with the play.  The global search (observer/global_search.py) is for few parameters
and distant initial values.  describe.py compares the results.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from lostmotion.lab.deadline import is_over
from lostmotion.lab.discrepancy.basis import wave_guess
from lostmotion.lab.observer.filter import STRONG, TIGHT
from lostmotion.lab.observer.objective import OUTSIDE, Follower, settled
from lostmotion.lab.shooting.parameters import Unknowns
from lostmotion.model import Model
from lostmotion.model.effects.registry import registered
from lostmotion.model.motion import FloatArray
from lostmotion.model.signals import TORQUE

__all__ = ["Descent", "best_wave"]

STEP = 1e-4
FAINT = 1e-6
SLOWEST_HZ, FASTEST_HZ, FASTEST = 1.0, 30.0, 0.45
"""Frequencies of sines: the lowest one, the highest one of a torque [Hz], and the highest one of a sensor as a share of
its rate."""
STEPS, TRIALS = 15, 6
ENOUGH = 3e-4


@dataclass(frozen=True, eq=False)
class Descent:
    """A local minimum of the cost, the mean of log(1 + (e/OUTSIDE)²) over innovations e in units of their expected
    deviation, over the free parameters of a model."""

    model: Model
    cost: float

    @classmethod
    def of(cls, model: Model, follower: Follower, coupling: float = STRONG) -> Descent:
        """The minimum that Levenberg-Marquardt steps from the values of a model lead to; coupling: of the observers."""
        unknowns = Unknowns.of(model, follower.rough)
        z, (low, high) = unknowns.z(model), unknowns.bounds
        (e,), damping = follower.errors([model], coupling), 1e-2
        cost = _cost(e)
        for _ in range(STEPS):
            if is_over() or not math.isfinite(cost):
                break
            moved = follower.errors([unknowns.put(model, z + step) for step in STEP * np.eye(z.size)], coupling)
            J, w = (moved.T - e[:, None]) / STEP, 1 / (1 + (e / OUTSIDE) ** 2)
            if not np.isfinite(J).all():
                break
            H, g = (J * w[:, None]).T @ J + np.diag(1 / unknowns.prior**2), (J * w[:, None]).T @ e
            before = cost
            for _ in range(TRIALS):
                dz = np.linalg.solve(H + damping * np.diag(np.diag(H)), -g)
                there = np.clip(z + np.clip(dz, -2.0, 2.0), low, high)
                (tried,) = follower.errors([unknowns.put(model, there)], coupling)
                if _cost(tried) < cost:
                    z, e, cost, damping = there, tried, _cost(tried), damping / 8
                    break
                damping *= 6
            if before - cost <= ENOUGH * before:
                break
        return cls(unknowns.put(model, z), cost)


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


def _cost(e: FloatArray) -> float:
    return float(np.mean(np.log1p((e / OUTSIDE) ** 2)))
