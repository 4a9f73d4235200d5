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
from lostmotion.model.assemble import scope
from lostmotion.model.effects import get_effect
from lostmotion.model.effects.base import Effect
from lostmotion.model.kernel import OPTIONS, compiled
from lostmotion.model.lanes import LANES, batches
from lostmotion.model.motion import FloatArray
from lostmotion.model.rk4 import Plan, Values, Work, beside, lanes_for, load, memory, rates, terms, work_for

__all__ = [
    "acceleration", "accelerations", "can_invert", "follows_motion", "inertia_of", "noise_floor", "simulable",
    "softened",
]  # fmt: skip


STEP, MOST_PARTS = 0.2, 50
"""Share of the shortest distance of a hysteresis that a step may take: the friction is then within 2 % of its law; and
the largest number of steps between two samples."""
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
    return not (effect.delay or effect.clock_rate) and (effect.distance is not None or not effect.states)


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
    """The same of several models (K, N), each with signals that differ in the zero of the position only.

    Samples are lanes (model/lanes.py) side by side.  Where states follow from the motion, samples follow one another,
    and models with the same effects, and as many steps between two samples, are lanes.
    """
    found = np.empty((len(models), drive.size))
    alike: dict[tuple[tuple[str, ...], int], list[int]] = {}
    for k, (model, one) in enumerate(zip(models, signals, strict=True)):
        if parts := _parts(model, one):
            alike.setdefault((model.effects, parts), []).append(k)
            continue
        plan, values, work = _prepared([model], one)
        _evaluate_samples(plan, values, one.time, one.position, one.velocity, drive, found[k], work)
    for (_, parts), members in alike.items():
        for lanes in batches(len(members)):
            at, one = members[lanes], signals[members[0]]
            plan, values, work = _prepared([models[k] for k in at], one)
            positions, some = np.array([signals[k].position for k in at]), np.empty((len(at), drive.size))
            _evaluate_models(plan, values, one.time, positions, one.velocity, drive, parts, some, work)
            found[at] = some
    return found


def _prepared(models: Sequence[Model], signals: Signals) -> tuple[Plan, Values, Work]:
    """The plan of models with the same terms, their values, and the memory of a run."""
    plans = [model.plan(signals.experiment.drive is not None) for model in models]
    values = beside(plans, [0.0])
    return plans[0], values, work_for(plans[0], values, np.zeros((len(models), plans[0].state_at.size)))


def _parts(model: Model, signals: Signals) -> int:
    """The number of integration steps between two samples for states that follow from the motion, 0 without any."""
    values = {name: p.value for name, p in model.parameters.items()}
    own = [effect for name in model.effects if (effect := get_effect(name)).distance]
    if not own:
        return 0
    shortest = min(effect.distance(scope(values, effect)) for effect in own if effect.distance)
    farthest = float(np.abs(np.diff(signals.position)).max())
    return min(max(math.ceil(farthest / (STEP * shortest)), 1), MOST_PARTS)


def _of_samples(
    plan: Any, values: Any, time: FloatArray, position: FloatArray, velocity: FloatArray, drive: FloatArray,
    found: FloatArray, work: Work,
) -> None:  # fmt: skip
    """Of one model without states of effects: samples are lanes."""
    m, w = terms(plan, values), memory(work)
    x, dx, still = w.x, w.k1, w.k2  # slopes of zero: one that is not finite would stay in all later samples
    for i in range(0, time.size, LANES):
        count = min(LANES, time.size - i)
        for k in range(count):
            w.time[k], w.value[k] = time[i + k], drive[i + k]
            x[k], x[LANES + k] = position[i + k], velocity[i + k]
        load(m, w, x, still, 0.0, w.none, 0, count)
        rates(m, w, dx, 0, count)
        for k in range(count):
            found[i + k] = dx[LANES + k]


def _of_models(
    plan: Any, values: Any, time: FloatArray, positions: FloatArray, velocity: FloatArray, drive: FloatArray,
    parts: int, found: FloatArray, work: Work,
) -> None:  # fmt: skip
    """Of models whose states follow from the motion: models are lanes; positions, found: (lanes, N)."""
    m, w = terms(plan, values), memory(work)
    n, x, dx, still, count = m.states, w.x, w.k1, w.k2, len(positions)
    end = lanes_for(count)
    for i in range(time.size):
        for k in range(end):
            w.time[k], w.value[k] = time[i], drive[i]
        for part in range(parts if i else 0):
            at, h = (part + 0.5) / parts, (time[i] - time[i - 1]) / parts
            for k in range(count):
                before, now = positions[k, i - 1], positions[k, i]
                x[k], x[LANES + k] = before + at * (now - before), (now - before) / (time[i] - time[i - 1])
            load(m, w, x, still, 0.0, w.none, 0, end)
            rates(m, w, dx, 0, end)
            for j in range(2 * LANES, n * LANES, LANES):
                for k in range(end):
                    x[j + k] += h * dx[j + k]
        for k in range(count):
            x[k], x[LANES + k] = positions[k, i], velocity[i]
        load(m, w, x, still, 0.0, w.none, 0, end)
        rates(m, w, dx, 0, end)
        for k in range(count):
            found[k, i] = dx[LANES + k]


_evaluate_samples = compiled(partial(njit, nogil=True, **OPTIONS), _of_samples)
_evaluate_models = compiled(partial(njit, nogil=True, **OPTIONS), _of_models)


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
