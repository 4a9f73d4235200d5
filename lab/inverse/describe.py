"""Describes the residual of a predictable motion by the state on which it depends.  Nothing is fitted here."""

from __future__ import annotations

import numpy as np

from lostmotion.lab import words
from lostmotion.lab.data.experiment import axis_of as axis_of_experiments
from lostmotion.lab.discrepancy.residual_maps import finding, residual_maps
from lostmotion.lab.fitting.identifiability import is_driven
from lostmotion.lab.inverse.problem import Data, by_recording
from lostmotion.lab.inverse.regression import Regression
from lostmotion.lab.quantity import quantity
from lostmotion.lab.results import Finding

__all__ = ["axis_of", "described"]


def axis_of(fit: Regression) -> tuple[bool, str]:
    """See ``experiment.axis_of``."""
    return axis_of_experiments([one.experiment for one in fit.data.signals])


def described(fit: Regression) -> Finding:
    """Describes on what the residual torque or motion depends."""
    data = fit.data
    is_joint, is_torque = "J" in fit.model.parameters, isinstance(data, Data)
    names = ("theta_2", "omega_2", "acceleration") if is_joint else ("q", "q'", "q''")
    variables = []
    for at, one in enumerate(data.shifted(fit.nuisance) if isinstance(data, Data) else data.signals):
        seen = one.time[one.kept] if is_torque else one.experiment.time[~np.isnan(one.experiment.measured[one.column])]
        states = zip(names, (one.position, one.velocity, one.acceleration), strict=True)
        variables.append({name: np.interp(seen, one.time, values) for name, values in states} | {"time": seen})
        if isinstance(data, Data) and is_driven(one.experiment):
            variables[-1]["torque"] = one.filtered(data.transmitted[at])
    residuals = by_recording(fit.misfit, data)
    found = residual_maps(residuals, {name: [one[name] for one in variables] for name in variables[0]})
    what, unit = words.column("torque" if is_torque else data.signals[0].column, *axis_of(fit))
    size = quantity(fit.error, unit, 2)
    text = (
        f"a {what} on the joint of about {size} is missing"
        if is_torque
        else f"an error of the motion of about {size} is left"
    )
    return finding("joint" if is_joint else "oscillator", text, unit, found)
