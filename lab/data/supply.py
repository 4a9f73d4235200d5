"""Parameters of a servo from its recorded voltage: the gain of its controller and the limit of its duty, or its supply.

A servo reports either the voltage of its motor, which depends on the position error, or its supply voltage, which does
not.  By the control law of the base, U duty = U sat(kp error_gain (theta_1 - theta_2)), the former is proportional to
the position error.  The values are given to the experiments (experiment.py) like metadata of a recording.
"""

from __future__ import annotations

import numpy as np

from lostmotion.drivers.recording import Recording
from lostmotion.lab.data.stand_ins import imported_columns
from lostmotion.model import Model
from lostmotion.model.motion import FloatArray

__all__ = ["SUPPLIES", "is_of_motor", "of_voltage", "supplied"]

FOLLOWS = 0.85
"""Share of the squared voltage that a line through zero takes, above which it is the motor's.  Of 12 recordings of a
servo the least is 0.989; a supply hardly follows the error, and none of 80 fell below 0.9 of its largest value."""
SUPPLIES = 0.7
"""Share of its largest value below which no supply falls (see above).  A motor's voltage stands at zero sometimes, but
one that is switched about an operating point falls to 0.54 of its largest value only; 0.7 is between 0.54 and 0.9."""
INSIDE = 0.9
"""Share of the largest voltage: readings below are not at the limit of the duty."""
AT_END = 1.15
"""Times the largest voltage: the duty has a limit where the line would exceed this."""


def is_of_motor(voltage: FloatArray) -> bool:
    """Whether a voltage (N,) is the motor's, and not its supply; False for none."""
    return bool(voltage.size) and float(voltage.min()) < SUPPLIES * float(voltage.max())


def supplied(recording: Recording) -> tuple[str, str]:
    """Why a voltage is not taken for the motor's, for a message, and the series that it was, "SERIES" where unknown."""
    why = f", which is never below {SUPPLIES} of its largest value, as that of a supply"
    return why, str(imported_columns(recording).get("voltage", "SERIES"))


def of_voltage(model: Model, recording: Recording) -> dict[str, float]:
    """The values of kp, cap and U that follow from the recorded voltage, those that are fixed parameters of the
    model."""
    columns = recording.columns
    if model.base != "servo" or any(name not in columns for name in ("voltage", "command", "position")):
        return {}
    voltage, error = columns["voltage"], columns["command"] - columns["position"]
    seen = np.isfinite(voltage) & np.isfinite(error)
    if seen.sum() < 2 or not voltage[seen].any():
        return {}
    found = _of_motor(model, voltage[seen], error[seen])
    return {name: value for name, value in found.items() if model.parameters[name].fixed}


def _of_motor(model: Model, voltage: FloatArray, error: FloatArray) -> dict[str, float]:
    most = float(np.abs(voltage).max())
    inside = np.abs(voltage) < INSIDE * most
    slope, follows = _line(voltage[inside], error[inside])
    if follows < FOLLOWS:
        return {"U": float(np.median(voltage))} if np.median(voltage) > 0 else {}
    supply = model.parameters["U"].value
    found = {"kp": slope / (supply * model.parameters["error_gain"].value)}
    if slope * float(np.abs(error).max()) > AT_END * most:
        found["cap"] = min(most / supply, 1.0)
    return found


def _line(voltage: FloatArray, error: FloatArray) -> tuple[float, float]:
    """Slope of a line through zero [V/rad], and the share of the squared voltage that it explains."""
    power = float(error @ error)
    if power == 0.0 or not voltage.any():
        return 0.0, 0.0
    slope = float(voltage @ error) / power
    return slope, slope**2 * power / float(voltage @ voltage)
