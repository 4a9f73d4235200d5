"""The bar of a recording of the service: its metadata have the resonance, the damping ratio and the length of the bar
that the service was calibrated with."""

from __future__ import annotations

import math
from collections.abc import Sequence

from lostmotion.drivers.recording import Recording
from lostmotion.lab.errors import ExperimentError
from lostmotion.model import Model

__all__ = ["bar_of"]


def bar_of(model: Model, recordings: Sequence[Recording]) -> dict[str, float]:
    """The parameters of a model with a bar that the recordings state: k = m omega², b = 2 zeta m omega, with omega = 2
    pi f_res, and the length l; none of other models.  The first recording that states a number counts.  Raises
    ExperimentError for one that is not positive."""
    values = {name: parameter.value for name, parameter in model.parameters.items()}
    if not {"k", "b", "m"} <= values.keys():
        return {}
    f_res_hz, zeta, length_m = (_stated(key, recordings) for key in ("f_res_hz", "zeta", "length_m"))
    omega = 2 * math.pi * f_res_hz or math.sqrt(values["k"] / values["m"])
    found = {
        "k": values["m"] * omega**2 if f_res_hz else 0.0,
        "b": 2 * zeta * values["m"] * omega,
        "l": length_m,
    }
    return {name: value for name, value in found.items() if value and name in values}


def _stated(key: str, recordings: Sequence[Recording]) -> float:
    """A number of the metadata; 0 where no recording has it."""
    for one in recordings:
        if key in one.metadata:
            value = one.metadata[key]
            if isinstance(value, bool) or not isinstance(value, int | float) or not 0 < value < math.inf:
                raise ExperimentError(f"{one.name}: # {key}: found {value!r}, expected a positive number")
            return float(value)
    return 0.0
