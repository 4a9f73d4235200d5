"""The first values of a fit with one more effect: its amplitude and nuisance parameters, to first order.

A candidate explains as much of the present residual as its change by the effect, projected off the fitted parameters,
explains linearly.  Nothing is fitted here, and nothing selected.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from lostmotion.lab import policy
from lostmotion.lab.inverse.output_error import OutputError
from lostmotion.lab.inverse.problem import InverseModel, Problem
from lostmotion.lab.inverse.regression import Regression
from lostmotion.lab.inverse.signals import Signals
from lostmotion.lab.shooting.least_squares import projected_off
from lostmotion.model import Model
from lostmotion.model.effects import get_effect
from lostmotion.model.effects.base import SHAFT_TURNS
from lostmotion.model.motion import FloatArray

__all__ = ["evaluated", "turns_of"]

ANGLES = 6
"""Zero angles of an encoder that are tried in a period of an effect: one of them is at most 30 degrees of phase off."""
ROUNDING = 1e-6
"""An effect that changes the residual by less than this share of it acts on a sensor that was not recorded."""
PARTS = (1.0, 0.5, 0.25, 0.1, 0.03)
"""Shares of the linearly extrapolated amplitude that are tried in turn."""


def evaluated(name: str, start: Model, now: Regression, data: Problem) -> tuple[float, Model, FloatArray] | None:
    """The decrease of the squared residual by an effect of this shape with the best amplitude, to first order; the
    model with that amplitude; and the initial nuisance parameters.  None where the motion does not cover the effect or
    it does not change the residual."""
    if not _covers(name, start, now.data):
        return None
    nuisance = _zeros(name, start, now, data)
    column = data.residual(start, nuisance) - now.residual
    if not np.isfinite(column).all() or column @ column <= ROUNDING**2 * (now.residual @ now.residual):
        return None
    own = projected_off(now.jacobian, column)
    power = float(own @ own)
    if power <= 1e-12 * float(column @ column):
        return None
    factor = -float(own @ now.residual) / power
    names = [f"{name}.{part}" for part in get_effect(name).amplitudes]
    signed = all(start.parameters[full].low < 0 for full in names)
    if names and (factor > 0 or signed):
        start = _sized(start, {full: start.parameters[full].value * factor for full in names}, now, data, nuisance)
    elif names:
        factor = 0.0
    return factor**2 * power, start, nuisance


def _zeros(name: str, start: Model, now: Regression, data: Problem) -> FloatArray:
    """The initial nuisance parameters of a fit with one more effect (E,).

    They are those of the present fit, completed by the initial values of free states that reduce the residual most.
    Zero angles on which the present fit does not depend are those with which the effect explains most of the residual
    of each recording.
    """
    if isinstance(data, OutputError):
        return data.begun(start, now.nuisance)
    if not isinstance(data, InverseModel) or not now.nuisance.size or now.jacobian[:, now.count :].any():
        return now.nuisance
    grid = np.arange(ANGLES) / ANGLES * math.tau / getattr(start.parameters.get(f"{name}.N"), "value", 1.0)
    alike = [_explained_shares(data.residual(start, zero + now.nuisance) - now.residual, now) for zero in grid]
    found = grid[np.argmax(alike, axis=0)]
    return np.asarray(np.where(data.nuisance_range < math.tau, now.nuisance, found))


def _explained_shares(column: FloatArray, now: Regression) -> list[float]:
    """The decrease of the norm of each recording's residual by this change of it (M,), projected off the fitted
    parameters; negative where the change has the wrong sign."""
    split = now.data.by_recording
    parts = zip(split(projected_off(now.jacobian, column)), split(now.residual), strict=True)
    return [-float(own @ residual) / max(float(np.linalg.norm(own)), 1e-100) for own, residual in parts]


def _sized(start: Model, sizes: dict[str, float], now: Regression, data: Problem, nuisance: FloatArray) -> Model:
    """The model with the largest share of the linearly extrapolated amplitudes with which the error is smaller than
    without the effect, so that the fit can descend; sizes: the amplitudes by name."""
    for part in PARTS:
        sized = start.replace({name: start.parameters[name].clipped(part * value) for name, value in sizes.items()})
        residual = data.residual(sized, nuisance)
        if np.isfinite(residual).all() and float(residual @ residual) < float(now.residual @ now.residual):
            break
    return sized


def _covers(name: str, model: Model, data: Problem) -> bool:
    """Whether the motion covers ``policy.LEAST_PERIODS`` of an effect that repeats N times a turn, at speeds at which
    its frequency is within the band; true for other effects.

    At higher speeds the effect shows only at the start and the end of a motion, where it can imitate any function.  N =
    1 is the law of a weight: it is tried on shafts only, and reported as confusable with the weight there.
    """
    turns = model.parameters.get(f"{name}.N")
    if turns is None:
        return True
    if turns.value == 1:
        return turns_of(data.signals) >= SHAFT_TURNS
    period = math.tau / turns.value
    return max(_travel(one, period * one.band_hz) for one in data.signals) > policy.LEAST_PERIODS * period


def _travel(signals: Signals, fastest: float) -> float:
    """The range of a motion [rad] at speeds up to ``fastest`` [rad/s]: the least of the range of its angle, the range
    of a sine with the same standard deviation (for a motion that dies away), and the distance travelled."""
    slow = np.abs(signals.velocity) < fastest
    if not slow.any():
        return 0.0
    step = float(signals.time[1] - signals.time[0])
    way = float(np.abs(signals.velocity[slow]).sum() * step)
    return min(float(np.ptp(signals.position[slow])), math.sqrt(8) * float(signals.position.std()), way)


def turns_of(signals: Sequence[Signals]) -> float:
    """The largest number of turns that the motion of a recording covers."""
    return max(float(np.ptp(one.position)) for one in signals) / math.tau
