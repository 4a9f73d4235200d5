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
    if not isinstance(data, Data):
        return _finding_of_motion(fit)
    residuals = by_recording(fit.misfit, data)
    variables = [
        {
            "theta_2": one.position[one.kept], "omega_2": one.velocity[one.kept],
            "acceleration": one.acceleration[one.kept], "time": one.time[one.kept],
            **({"torque": one.filtered(load)} if is_driven(one.experiment) else {}),
        }
        for one, load in zip(data.shifted(fit.nuisance), data.transmitted, strict=True)
    ]  # fmt: skip
    found = residual_maps(residuals, {name: [one[name] for one in variables] for name in variables[0]})
    what, unit = words.column("torque", *axis_of(fit))
    return finding("joint", f"a {what} on the joint of about {quantity(fit.error, unit, 2)} is missing", unit, found)


def _finding_of_motion(fit: Regression) -> Finding:
    """Describes on what the residual motion depends."""
    unit = words.column(fit.data.signals[0].column, *axis_of(fit))[1]
    residuals = by_recording(fit.misfit, fit.data)
    names = ("theta_2", "omega_2", "acceleration") if "J" in fit.model.parameters else ("q", "q'", "q''")
    variables = []
    for one in fit.data.signals:
        seen = ~np.isnan(one.experiment.measured[one.column])
        at = one.experiment.time[seen]
        states = (one.position, one.velocity, one.acceleration)
        columns = {name: np.interp(at, one.time, values) for name, values in zip(names, states, strict=True)}
        variables.append({**columns, "time": at})
    found = residual_maps(residuals, {name: [one[name] for one in variables] for name in variables[0]})
    acts_on = "joint" if "J" in fit.model.parameters else "oscillator"
    return finding(acts_on, f"an error of the motion of about {quantity(fit.error, unit, 2)} is left", unit, found)
