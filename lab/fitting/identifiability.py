"""Structural identifiability: a parameter that no recording can determine, due to a symmetry of the equations of
motion.

The motion of a joint that swings freely, or of a bar that rings down, is unchanged when its inertia and all forces grow
by the same factor.  The inertia is then held at its value, and forces are relative to it.  A shaft that coasts down has
one direction, in which dry friction is a constant torque.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from lostmotion.lab.data.experiment import ACCEL, Experiment
from lostmotion.lab.results import Estimate
from lostmotion.model import Model
from lostmotion.model.bases import get_base
from lostmotion.model.effects import get_effect
from lostmotion.model.effects.base import SHAFT_TURNS
from lostmotion.model.motion import FloatArray

__all__ = ["coasts", "free_states", "held", "is_driven", "with_free_states", "with_scale"]

PLACES, ONWARD = 100, 0.9
"""Number of places, and the share of the way between them that leads on: a turn back of a tenth is no coasting."""


def is_driven(experiment: Experiment) -> bool:
    """Whether an input acts: one was recorded, and is not zero throughout."""
    return experiment.drive is not None and bool(np.any(experiment.drive.position(experiment.time)))


def with_scale(model: Model, experiments: Sequence[Experiment]) -> tuple[Model, tuple[Estimate, ...]]:
    """The model without the parameters that no fit to these experiments can identify: where no input was recorded, the
    scale of its forces is held at its value, and so is a constant force that looks like something else.  Also returns
    the held scale, as an estimate that is not identified."""
    is_driven_once = any(map(is_driven, experiments))
    if not is_driven_once:
        model = with_free_states(model)
    if "bias" in model.parameters and not _is_bias_identified(model, experiments, is_driven_once):
        model = held(model, ["bias"])
    name = get_base(model.base).scale
    if is_driven_once or not name or model.parameters[name].fixed:
        return model, ()
    parameter = model.parameters[name]
    scale = Estimate(name, parameter.value, parameter.value, parameter.value, parameter.unit, identified=False)
    return held(model, [name]), (scale,)


def _is_bias_identified(model: Model, experiments: Sequence[Experiment], is_driven_once: bool) -> bool:
    """Whether these experiments distinguish the constant force of a base from all else.  An accelerometer does not feel
    where a bar rests, and a shaft that coasts down in one direction is braked by a constant force as by dry friction.
    The bias of an accelerometer is always distinguished."""
    if model.parameters["bias"].unit == "m/s^2":
        return True
    if all(set(one.measured) == {ACCEL} for one in experiments):
        return False
    shafts = model.base == "joint" and not is_driven_once
    return not (shafts and all(coasts(next(iter(one.measured.values())), one.is_linear) for one in experiments))


def coasts(position: FloatArray, is_linear: bool) -> bool:
    """Whether a shaft at these angles (N,) turns freely in one direction, too far for a spring or a weight; turns of
    between a hundred places, as noise reverses between samples.  is_linear: the position is a length."""
    position = position[np.isfinite(position)]
    steps = np.diff(position[np.linspace(0, position.size - 1, PLACES).astype(int)])
    way = abs(float(steps.sum()))
    return not is_linear and way > 2 * np.pi * SHAFT_TURNS and way > ONWARD * float(np.abs(steps).sum())


def held(model: Model, names: Iterable[str]) -> Model:
    """The model with these parameters fixed at their values."""
    return model.replace({name: replace(model.parameters[name], fixed=True) for name in names})


def with_free_states(model: Model) -> Model:
    """The model of a motion that no input drives, in which the initial values of an effect's free states are its
    amplitudes: those among its parameters are held.  Nothing is there to push a joint whose weight has an angle of
    rest: a constant torque would be the dry friction of an arm that falls in one direction."""
    free = [get_effect(name) for name in model.effects if get_effect(name).free_states]
    model = held(model, [f"{effect.id}.{name}" for effect in free for name in effect.amplitudes])
    rests_by = {get_effect(name).rests_by for name in model.effects} - {""}
    bias = model.parameters.get("bias")
    if not rests_by or not bias or bias.fixed == ("bias" not in rests_by):
        return model
    return model.replace({"bias": replace(bias, value=0.0, fixed=not bias.fixed)})


def free_states(model: Model, is_moved: bool) -> tuple[str, ...]:
    """The names of those states of effects with free initial values: in a motion that an input drives the lags, whose
    states depend on what the input was before the recording, else those that only their initial values set in
    motion."""
    effects = {
        name for name in model.effects
        if (any(one is not None for one in get_effect(name).states) if is_moved else get_effect(name).free_states)
    }  # fmt: skip
    return tuple(name for name in model.state_names if name.split(".")[0] in effects)
