"""How far a simulation can be trusted: convergence by halving the step, and the horizon of predictability.

With weak contact damping the gear model is chaotic: impacts amplify any difference until two runs have nothing in
common but their statistics.  No step is small enough then; the horizon is how long single samples mean something.
"""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from lostmotion.model.errors import ChaoticMotionWarning
from lostmotion.model.model import Model
from lostmotion.model.motion import FloatArray, Motion
from lostmotion.model.trajectory import Trajectory

__all__ = ["Check", "check", "predictability_horizon"]

WINDOW_S = 0.1
DECORRELATED = 0.5
"""Difference of two runs over a window, as a share of the signal's root mean square, from which they count as apart."""


@dataclass(frozen=True)
class Check:
    """substep_s: the step [s]; error: root mean square difference from a run at half the step over the signal's own,
    within the horizon; horizon_s: how long the motion can be predicted [s], inf for the whole record."""

    substep_s: float
    error: float
    horizon_s: float


def check(
    model: Model,
    drive: Motion | None,
    times: ArrayLike,
    state: ArrayLike | None = None,
    *,
    substep_s: float | None = None,
) -> Check:
    """Simulates again at half the step and with perturbed parameters.

    Warns with ChaoticMotionWarning when the horizon ends within the record.  Costs four simulations.
    """
    coarse = model.simulate(drive, times, state, substep_s=substep_s)
    fine = model.simulate(drive, times, state, substep_s=coarse.substep_s / 2)
    horizon = predictability_horizon(model, drive, times, state, substep_s=coarse.substep_s)
    if math.isfinite(horizon):
        warnings.warn(
            f"this motion is chaotic: after {horizon:.2g} s a change of 1e-6 in the parameters has changed everything",
            ChaoticMotionWarning,
            stacklevel=2,
        )
    within = coarse.time - coarse.time[0] <= horizon
    one, other = _main_signal(coarse)[within], _main_signal(fine)[within]
    return Check(coarse.substep_s, _rms(one - other) / max(_rms(other), 1e-300), horizon)


def predictability_horizon(
    model: Model,
    drive: Motion | None,
    times: ArrayLike,
    state: ArrayLike | None = None,
    *,
    perturbation: float = 1e-6,
    substep_s: float | None = None,
) -> float:
    """Time after the start [s] from which a relative change of all free parameters has decorrelated the motion.

    Parameters that are whole numbers stay as they are.  The time is that of the first window of 0.1 s in which two runs
    differ by half the signal's root mean square (accel, or else position); inf when there is none within the times.
    """
    free = {name: p.value for name, p in model.parameters.items() if not (p.fixed or p.domain.is_whole)}
    given = {name: value * (1 + perturbation) for name, value in free.items()}
    one = model.simulate(drive, times, state, substep_s=substep_s)
    other = model.replace(given).simulate(drive, times, state, substep_s=one.substep_s)
    apart = (_main_signal(one) - _main_signal(other)) ** 2
    limit = DECORRELATED * _rms(_main_signal(one))
    windows = ((one.time - one.time[0]) / WINDOW_S).astype(int)
    _, starts = np.unique(windows, return_index=True)
    rms = np.sqrt(np.add.reduceat(apart, starts) / np.diff([*starts, apart.size]))
    late = np.flatnonzero(rms > limit)
    return float(windows[starts[late[0]]] * WINDOW_S) if late.size else math.inf


def _main_signal(trajectory: Trajectory) -> FloatArray:
    return next(trajectory[name] for name in ("accel", "position") if name in trajectory.signals)


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))
