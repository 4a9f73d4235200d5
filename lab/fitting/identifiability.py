"""Structural identifiability: parameters that these recordings cannot determine, due to a symmetry of the equations of
motion.

The motion of a joint that swings freely, or of a bar that rings down, does not change if its inertia and all forces
grow by the same factor.  The inertia is then held at its value, and forces are relative to it.  A shaft that turns in
one direction, as one that coasts down, has a dry friction that is a constant torque.  Every fit holds these parameters
before it begins.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from lostmotion.lab.data.experiment import ACCEL, Experiment
from lostmotion.lab.data.series import direction, is_onward, seen
from lostmotion.lab.results import Estimate
from lostmotion.lab.shooting.parameters import held
from lostmotion.model import Model
from lostmotion.model.bases import get_base
from lostmotion.model.effects import get_effect
from lostmotion.model.effects.base import SHAFT_TURNS
from lostmotion.model.motion import FloatArray

__all__ = ["coasts", "free_states", "with_free_states", "with_scale"]

log = logging.getLogger(__name__)


def with_scale(model: Model, experiments: Sequence[Experiment]) -> tuple[Model, tuple[Estimate, ...]]:
    """The model without the parameters that no fit to these experiments can identify: where no input was recorded, the
    scale of its forces is held at its value, and so is a constant force that looks like something else.  Also returns
    the held scale, as an estimate that is not identified."""
    is_driven = any(one.is_driven for one in experiments)
    if not is_driven:
        model = with_free_states(model)
    if "bias" in model.parameters and not _is_bias_identified(model, experiments):
        model = _with_held_bias(model, experiments, is_driven)
    name = get_base(model.base).scale
    if is_driven or not name or model.parameters[name].fixed:
        return model, ()
    parameter = model.parameters[name]
    scale = Estimate(name, parameter.value, parameter.value, parameter.value, parameter.unit, identified=False)
    return held(model, [name]), (scale,)


def _with_held_bias(model: Model, experiments: Sequence[Experiment], is_driven: bool) -> Model:
    """The model with its constant force held at its value.  Of a driven shaft a warning says what else may
    be constant: it has a sensor or a motor whose torque may have an offset."""
    bias = model.parameters["bias"]
    if model.base == "joint" and is_driven and not bias.fixed:
        log.warning(
            "%s: the shaft turns in one direction, in which a constant torque acts as dry friction does; it is held "
            "at %g, so that a load, or an offset of the torque, counts as dry friction",
            experiments[0].name, bias.value,
        )  # fmt: skip
    return held(model, ["bias"])


def _is_bias_identified(model: Model, experiments: Sequence[Experiment]) -> bool:
    """Whether these experiments distinguish the constant force of a base from all else.  An accelerometer does not feel
    where a bar rests, and a shaft that turns in one direction is braked by a constant force as by dry friction.  The
    bias of an accelerometer is always distinguished."""
    if model.parameters["bias"].unit == "m/s^2":
        return True
    if all(set(one.measured) == {ACCEL} for one in experiments):
        return False
    return model.base != "joint" or not _turns_one_way(experiments)


def _turns_one_way(experiments: Sequence[Experiment]) -> bool:
    """Whether a shaft turns in one direction, the same in all experiments; see ``coasts``."""
    positions = [one.measured.get("position", np.zeros(2)) for one in experiments]
    turned = [coasts(one, e.is_linear) for one, e in zip(positions, experiments, strict=True)]
    return all(turned) and direction(positions) != 0


def coasts(position: FloatArray, is_linear: bool) -> bool:
    """Whether a shaft with these angles (N,) [rad] turns in one direction, farther than a spring or a weight allows;
    false for a length (is_linear)."""
    position = seen(position)
    return not is_linear and abs(position[-1] - position[0]) > 2 * np.pi * SHAFT_TURNS and is_onward(position)


def with_free_states(model: Model) -> Model:
    """The model for a motion that no input drives.

    The initial values of an effect's free states then are its amplitudes, so that amplitudes among its parameters are
    held.  The equilibrium of a torque with a restoring effect is determined by one parameter (``rests_by``).  Where
    that is not the constant torque, this is held at zero: for an arm that falls in one direction it would be the dry
    friction.
    """
    free = [get_effect(name) for name in model.effects if get_effect(name).free_states]
    model = held(model, [name for effect in free for name in effect.amplitude_names])
    rests_by = {get_effect(name).rests_by for name in model.effects} - {""}
    bias = model.parameters.get("bias")
    if not rests_by or not bias or bias.fixed == ("bias" not in rests_by):
        return model
    return model.replace({"bias": replace(bias, value=0.0, fixed=not bias.fixed)})


def free_states(model: Model, is_driven: bool) -> tuple[str, ...]:
    """The names of the states of effects whose initial values are fitted.

    is_driven: whether an input drives the motion.  Then they are the states of lags, which depend on the input before
    the recording; else those that only their initial values set in motion.
    """
    effects = {
        name for name in model.effects
        if (any(one is not None for one in get_effect(name).states) if is_driven else get_effect(name).free_states)
    }  # fmt: skip
    return tuple(name for name in model.state_names if name.split(".")[0] in effects)
