"""The acceleration of a model for a given motion, and the speed within which its dry friction changes its sign.

The terms are the kernels of the model, so that effects of the catalogue and user-defined ones are evaluated alike.  No
equation of motion is solved here.  So effects with a delay or a time dependence cannot be evaluated, nor effects with
states, except states that follow from the measured motion (``follows_motion``).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
from numba import njit

from lostmotion.lab import policy
from lostmotion.lab.data.series import rms
from lostmotion.lab.inverse.signals import Signals
from lostmotion.model import Model, build_model
from lostmotion.model.assemble import in_order
from lostmotion.model.effects import get_effect
from lostmotion.model.effects.base import Effect
from lostmotion.model.kernel import OPTIONS, compiled
from lostmotion.model.lanes import LANES
from lostmotion.model.motion import FloatArray
from lostmotion.model.rk4 import Work, beside, load, memory, rates, terms, work_for

__all__ = [
    "acceleration", "accelerations", "can_invert", "follows_motion", "inertia_of", "noise_floor", "simulable",
    "softened",
]  # fmt: skip


SATURATED = 3.0
"""Ratio of the speed below which a sample is at rest to the width omega_0 of dry friction tanh(omega/omega_0): tanh(3)
= 0.995 of the friction acts in each sample that is compared.  With one width 0.76 of it acted in the slowest, and of
eight simulated joints that were known to 0.2 % no interval held (Coulomb friction 0.9 % too large, viscous 0.4 % too
small; 0.04 % with three)."""

HOLDS = 10.0
"""The same for a servo whose motion is simulated: at a usual speed of 1 rad/s it is the default width of 2 mrad/s."""


def follows_motion(effect: Effect) -> bool:
    """Whether an effect is a torque that follows from the measured motion up to the same instant: it has no delay, no
    time dependence, and no states but those that depend on the distance travelled."""
    return not (effect.delay or effect.clock_rate) and (effect.along is not None or not effect.states)


def can_invert(model: Model) -> bool:
    """Whether the torque of a model follows from the measured motion: a ``joint`` whose effects all do."""
    return model.base == "joint" and all(follows_motion(get_effect(name)) for name in model.effects)


def inertia_of(model: Model) -> float:
    """The inertia of a joint J [kg m²], or the mass of an oscillator m [kg]."""
    return next(model.parameters[name].value for name in ("J", "m") if name in model.parameters)


def noise_floor(signals: Signals, model: Model) -> float:
    """Root mean square within the band of the noise of the measured torque and of the torque that the measured motion
    needs [N m]."""
    return math.hypot(signals.torque_noise, inertia_of(model) * signals.acceleration_noise)


def acceleration(model: Model, signals: Signals, drive: FloatArray) -> FloatArray:
    """theta_2'' or q'' (N,) [rad/s² or m/s²] of the equation of motion at the measured position and speed.

    drive: (N,) the input at the signals' times.
    """
    return np.asarray(accelerations([model], [signals], drive)[0])


def accelerations(models: Sequence[Model], signals: Sequence[Signals], drive: FloatArray) -> FloatArray:
    """The same of several models (K, N), each with signals that differ in the zero of the position only."""
    found = np.empty((len(models), drive.size))
    for model, one, out in zip(models, signals, found, strict=True):
        plan = model.plan(one.experiment.drive is not None)
        values = beside([plan], [0.0])
        work = work_for(plan, values, np.zeros((1, plan.state_at.size)))
        _evaluate(plan, values, one.time, one.position, one.velocity, _states(model, one), drive, out, work)
    return found


def _states(model: Model, signals: Signals) -> FloatArray:
    """The states of effects along the measured motion (S, N), in the order of the model."""
    found = [
        along(signals.position, {name: p.value for name, p in model.own(effect.id).items()})
        for effect in in_order([get_effect(name) for name in model.effects])
        if (along := effect.along)
    ]
    return np.array(found).reshape(len(found), signals.time.size)


def _of_samples(
    plan: Any, values: Any, time: FloatArray, position: FloatArray, velocity: FloatArray, states: FloatArray,
    drive: FloatArray, found: FloatArray, work: Work,
) -> None:  # fmt: skip
    """Samples are lanes (model/lanes.py); states: (S, N)."""
    m, w = terms(plan, values), memory(work)
    x, dx, still = w.x, w.k1, w.k2  # slopes of zero: one that is not finite would stay in all later samples
    for i in range(0, time.size, LANES):
        count = min(LANES, time.size - i)
        for k in range(count):
            w.time[k], w.value[k] = time[i + k], drive[i + k]
            x[k], x[LANES + k] = position[i + k], velocity[i + k]
            for j in range(states.shape[0]):
                x[(2 + j) * LANES + k] = states[j, i + k]
        load(m, w, x, still, 0.0, w.none, 0, count)
        rates(m, w, dx, 0, count)
        for k in range(count):
            found[i + k] = dx[LANES + k]


_evaluate = compiled(partial(njit, nogil=True, **OPTIONS), _of_samples)


def softened(model: Model, signals: Sequence[Signals], saturation: float = SATURATED) -> Model:
    """The model with dry friction that changes its sign within the speed of samples at rest: its fixed widths omega_0
    are at least ``policy.UNSURE_SPEED`` of the usual speed over ``saturation``.  Default widths are replaced by this
    one: a default in rad/s is too wide for a slow joint or a linear axis."""
    width = policy.UNSURE_SPEED / saturation * rms(*(one.velocity for one in signals))
    usual = build_model(model.base, model.effects).parameters
    widths = {
        name: width
        for name, parameter in model.parameters.items()
        if name.endswith(".omega_0") and parameter.fixed and (parameter.value < width or parameter == usual[name])
    }
    return model.replace(widths)


def simulable(model: Model, signals: Sequence[Signals]) -> Model:
    """The model with widths of dry friction for a simulation; see ``softened``.  A servo holds its load at rest for
    much of a recording, and would creep with a larger width."""
    return softened(model, signals, HOLDS if model.base == "servo" else 1.0)
