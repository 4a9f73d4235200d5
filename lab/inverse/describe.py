"""Describes the residual of a predictable motion by the states on which it depends: the last stage of the search,
where no effect explains it.  Nothing is fitted here."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lostmotion.lab import words
from lostmotion.lab.discrepancy.residual_maps import finding, residual_maps
from lostmotion.lab.inverse.problem import InverseModel
from lostmotion.lab.inverse.regression import Regression
from lostmotion.lab.inverse.signals import Signals
from lostmotion.lab.quantity import quantity
from lostmotion.lab.results import Finding
from lostmotion.model.motion import FloatArray

__all__ = ["described"]


def described(fit: Regression) -> Finding:
    """The size of the residual torque or motion, and the states on which it depends (residual_maps.py); of a torque
    also whether it is a dry friction whose size depends on the place."""
    data = fit.data
    is_joint = "J" in fit.model.parameters
    place, speed, _ = names = ("theta_2", "omega_2", "acceleration") if is_joint else ("q", "q'", "q''")
    if isinstance(data, InverseModel):
        variables = [
            _states(one, names, one.time[one.kept])
            | ({"torque": one.filtered(load)} if one.experiment.is_driven else {})
            for one, load in zip(data.shifted(fit.nuisance), data.transmitted, strict=True)
        ]
        what, unit = words.column(data.column, *data.axis)
        text = f"a {what} on the joint of about {quantity(fit.error, unit, 2)} is left in what was fitted"
    else:
        times = [one.experiment.time[~np.isnan(one.experiment.measured[one.column])] for one in data.signals]
        variables = [_states(one, names, time) for one, time in zip(data.signals, times, strict=True)]
        unit = words.column(data.column, *data.axis)[1]
        text = f"an error of the motion of about {quantity(fit.error, unit, 2)} is left in what was fitted"
    residuals = data.by_recording(fit.misfit)
    found = residual_maps(residuals, {name: [one[name] for one in variables] for name in variables[0]})
    along = [r * np.sign(one[speed]) for r, one in zip(residuals, variables, strict=True)]
    places = {place: [one[place] for one in variables]} if isinstance(data, InverseModel) else {}
    rubbing = residual_maps(along, places)  # of a torque only: a motion trails what acts on it
    return finding("joint" if is_joint else "oscillator", text, unit, found, rubbing, speed)


def _states(signals: Signals, names: Sequence[str], time: FloatArray) -> dict[str, FloatArray]:
    """Position, speed and acceleration under these names, and the time, at these times (N,) [s]."""
    states = zip(names, (signals.position, signals.velocity, signals.acceleration), strict=True)
    return {name: np.interp(time, signals.time, values) for name, values in states} | {"time": time}
