"""The torque that a model needs for a given motion: J theta_2'' less all that acts on the joint.

The terms are the model's own kernels, so an effect of the catalogue and one of a user's own are evaluated alike.
Nothing is integrated here, so only effects without states, delays and clocks can be evaluated (``can_invert``).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from lostmotion.lab.inverse.signals import Signals
from lostmotion.model import Model
from lostmotion.model.assemble import assemble, in_order
from lostmotion.model.bases import get_base
from lostmotion.model.effects import get_effect
from lostmotion.model.effects.base import Effect
from lostmotion.model.kernel import OPTIONS, compiled
from lostmotion.model.motion import FloatArray
from lostmotion.model.signals import DRIVEN, TORQUE
from lostmotion.model.solve import load, rates

__all__ = ["can_invert", "is_static", "needed"]


def is_static(effect: Effect) -> bool:
    """Whether an effect is a torque that follows from the motion at the same instant."""
    return not (effect.states or effect.delay or effect.clock_rate)


def can_invert(model: Model) -> bool:
    """Whether the model's torque follows from the motion: the base ``joint`` with static effects only."""
    return model.base == "joint" and all(is_static(get_effect(name)) for name in model.effects)


def needed(model: Model, signals: Signals, transmitted: FloatArray) -> FloatArray:
    """The torque that the motion needs of a model, J theta_2'' less that of bias and effects (N,) [N m].

    transmitted: (N,) the torque [N m] on which friction that grows with load depends.  It is a modelled one: that of
    the sensor holds the very friction that is asked for.
    """
    acting = np.empty(signals.time.size)
    _evaluate(_plan(model), signals.time, signals.position, signals.velocity, transmitted, acting)
    return np.asarray(model.parameters["J"].value * signals.acceleration - (acting - transmitted))


def _plan(model: Model) -> Any:
    effects = in_order([get_effect(name) for name in model.effects])
    plan = assemble(get_base(model.base), effects, {name: p.value for name, p in model.parameters.items()})
    start = plan.start.copy()
    start[DRIVEN] = 1.0
    return plan._replace(start=start)


def _run(
    plan: Any, time: FloatArray, position: FloatArray, velocity: FloatArray, torque: FloatArray, acting: FloatArray
) -> None:
    s = plan.start.copy()
    x, dx = np.empty(2), np.zeros(3)
    for i in range(time.size):
        x[0], x[1] = position[i], velocity[i]
        load(plan, s, time[i], torque[i], 0.0, x, dx, 0.0)
        rates(plan, s, dx)
        acting[i] = s[TORQUE]


_evaluate = compiled(lambda **options: njit(nogil=True, **OPTIONS, **options)(_run))
