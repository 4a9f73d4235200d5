"""Parameters that recordings cannot tell, whatever the noise: an exact symmetry of the equations of motion.

A joint that swings freely, or a bar that rings down, moves alike when its inertia and all forces are larger by the same
factor.  The inertia is then held at its value, and forces are told as ratios to it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from lostmotion.lab.data.experiment import Experiment
from lostmotion.lab.results import Estimate
from lostmotion.model import Model
from lostmotion.model.bases import get_base

__all__ = ["is_driven", "with_scale"]


def is_driven(experiment: Experiment) -> bool:
    """Whether an input acts: one was recorded, and is not zero throughout."""
    return experiment.drive is not None and bool(np.any(experiment.drive.position(experiment.time)))


def with_scale(model: Model, experiments: Sequence[Experiment]) -> tuple[Model, tuple[Estimate, ...]]:
    """The model with the scale of its forces held where no recording has an input, and what is held."""
    name = get_base(model.base).scale
    if not name or model.parameters[name].fixed or any(is_driven(one) for one in experiments):
        return model, ()
    parameter = model.parameters[name]
    held = Estimate(name, parameter.value, parameter.value, parameter.value, parameter.unit, told=False)
    return model.replace({name: replace(parameter, fixed=True)}), (held,)
