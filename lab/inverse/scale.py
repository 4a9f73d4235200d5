"""The scale of a servo's torques, which its motion does not identify.

J theta'' = kt (U duty - kt omega)/R - b omega - ...: with kt, J and all torques multiplied by one number, and b changed
by what the back EMF then lacks, the motion is the same, also where the duty is at its cap.  So a fit identifies ratios
to kt.  The search has a prior for this direction; here, after it, kt is held.
"""

from __future__ import annotations

from lostmotion.lab import policy
from lostmotion.lab.inverse.output_error import OutputError
from lostmotion.lab.inverse.regression import Regression, regressed
from lostmotion.lab.results import Estimate
from lostmotion.lab.shooting.parameters import held
from lostmotion.model import Model, ModelError, Parameter

__all__ = ["scaled"]

SCALE = "kt"
"""The parameter of a servo to which all torques are relative."""


def scaled(fit: Regression, rough: Model) -> tuple[Regression, tuple[Estimate, ...]]:
    """The fit with the scale of the torques held, and that as an estimate that is not identified; the fit as it is of
    other models, and where the file holds kt, the inertia or another torque, which tells the scale.

    It is held at the value of the model file, if a fit with it leaves as much, within ``policy.LEAST_GAIN`` of the
    squared error, as it does where viscous friction makes up for the back EMF; else at the value that the fit has,
    beside which no viscous friction would be distinguished.  The candidates of a search are not asked.
    """
    if not isinstance(fit.data, OutputError) or fit.model.base != "servo" or SCALE not in fit.unknowns.names:
        return fit, ()
    if any(p.fixed and p.value for name, p in fit.model.parameters.items() if name != SCALE and _is_torque(p)):
        return fit, ()
    own = fit.model.parameters[SCALE]
    for value in (rough.parameters[SCALE].value, own.value):
        found = _held_at(value, fit)
        if found and not policy.is_less(fit.rms, found.rms):
            return found, (Estimate(SCALE, value, value, value, own.unit, identified=False),)
    return fit, ()


def _is_torque(parameter: Parameter) -> bool:
    """Whether a parameter is a torque, also one per speed or acceleration."""
    return parameter.unit.startswith(("N m", "kg"))


def _held_at(scale: float, fit: Regression) -> Regression | None:
    """The fit with the scale held at a value, from where its torques and its inertia are in proportion; None where it
    cannot be simulated."""
    known, ratio = fit.model.parameters, scale / fit.model.parameters[SCALE].value
    torques = [name for name in fit.unknowns.names if _is_torque(known[name])]
    moved = fit.model.replace({name: known[name].clipped(ratio * known[name].value) for name in torques})
    model = held(moved.replace({SCALE: scale}), [SCALE])
    try:
        return regressed(model, fit.data, fit.nuisance)
    except ModelError:
        return None
