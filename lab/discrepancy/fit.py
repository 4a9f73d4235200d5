"""Local minimisation of the prediction error of observers over many small parameters at once.

With a high observer gain the prediction error is nearly linear in the parameters, so that a curve with a dozen values
can be fitted from zero, together with the play.  The global search (observer/global_search.py) is for few parameters
and distant initial values.  describe.py compares the results.
"""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from lostmotion.lab.deadline import FitEndsError, is_over
from lostmotion.lab.discrepancy.basis import wave_guess
from lostmotion.lab.observer.filter import STRONG, TIGHT
from lostmotion.lab.observer.objective import OUTSIDE, Follower, settled
from lostmotion.lab.shooting.parameters import Unknowns
from lostmotion.model import Model, ModelError
from lostmotion.model.effects.registry import registered
from lostmotion.model.motion import FloatArray
from lostmotion.model.signals import TORQUE

__all__ = ["Descent", "best_wave"]

STEP = 1e-4
FAINT = 1e-6
SLOWEST_HZ, FASTEST_HZ, FASTEST = 1.0, 30.0, 0.45
"""Frequencies of sines: the lowest one, the highest one of a torque [Hz], and the highest one of a sensor as a share of
its rate."""
STEPS = 20
ENOUGH = 3e-4


@dataclass(frozen=True, eq=False)
class Descent:
    """A local minimum of the cost, the mean of log(1 + (e/OUTSIDE)²) over innovations e in units of their expected
    deviation, over the free parameters of a model."""

    model: Model
    cost: float

    @classmethod
    def of(cls, model: Model, follower: Follower, coupling: float = STRONG) -> Descent:
        """The minimum that least squares with Cauchy's loss leads to from the values of a model, or the model as it is
        where an observer diverges or the time is up; coupling: of the observers."""
        unknowns = Unknowns.of(model, follower.rough)

        def errors(z: FloatArray) -> FloatArray:
            return _errors(unknowns.put(model, z), follower, coupling)

        def jacobian(z: FloatArray) -> FloatArray:
            here, *moved = (errors(z + step) for step in STEP * np.eye(z.size + 1)[:, 1:])
            slopes = (np.array(moved) - here).T / STEP
            if is_over() or not np.isfinite(slopes).all():
                raise FitEndsError
            return np.asarray(slopes)

        first = np.clip(unknowns.z(model), *unknowns.bounds)
        found = cls(model, _cost(errors(first)))
        if math.isfinite(found.cost):
            with suppress(FitEndsError):
                best = least_squares(
                    errors, first, jacobian, unknowns.bounds,
                    x_scale="jac", loss="cauchy", f_scale=OUTSIDE, max_nfev=STEPS, ftol=ENOUGH,
                )  # fmt: skip
                found = cls(unknowns.put(model, best.x), _cost(best.fun))
        return found


def best_wave(model: Model, follower: Follower, target: int) -> float:
    """The frequency [Hz] of the sine on a signal (target) that, to first order, explains most of the innovations of
    observers with a high gain, with the other parameters unchanged.

    A sine of the sensor is assumed to appear in the innovations with its frequency and any amplitude and phase.
    """
    fastest = FASTEST_HZ if target == TORQUE else FASTEST * follower.segments[0].rate_hz
    e = _errors(model, follower, TIGHT)
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
        moved = [_errors(own.replace({f"{guess.effect.id}.{part}": FAINT}), follower, TIGHT) for part in "ab"]
    return np.asarray((np.array(moved) - e).T)


def _sensor_wave(follower: Follower, hz: float) -> FloatArray:
    """Sine and cosine at the times of the innovations (N, 2)."""
    time = np.concatenate([segment.time[settled(segment)] for segment in follower.segments])
    return np.column_stack([np.sin(2 * math.pi * hz * time), np.cos(2 * math.pi * hz * time)])


def _errors(model: Model, follower: Follower, coupling: float) -> FloatArray:
    """The innovations (N,), see ``Follower.errors``; infinite where the model cannot be simulated."""
    try:
        return follower.errors(model, coupling)
    except ModelError:
        return np.full(sum(s.time[settled(s)].size for s in follower.segments), np.inf)


def _cost(e: FloatArray) -> float:
    return float(np.mean(np.log1p((e / OUTSIDE) ** 2)))
