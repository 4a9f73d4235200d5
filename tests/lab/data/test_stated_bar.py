"""The bar that a recording of the service states."""

from __future__ import annotations

import math

import numpy as np
import pytest

from lostmotion.drivers.recording import Recording
from lostmotion.lab.data.stated_bar import bar_of
from lostmotion.lab.errors import ExperimentError
from lostmotion.lab.models.modelfile import loads
from lostmotion.model import build_model

BAR = {"f_res_hz": 90.0, "zeta": 0.03, "length_m": 0.05}


def recorded(**metadata: object) -> Recording:
    times = np.arange(0.0, 1.0, 0.01)
    return Recording(times, {"command": times, "accel": times}, dict(metadata), name="elbow.csv")


def test_resonance_damping_and_length_are_those_of_the_recording() -> None:
    """What the model file states counts more; other bases have no bar."""
    file = loads('base = "play"\n[parameters]\nb = 0.2\nm = 0.03\n', "elbow.toml")
    model = file.build(bar_of(file.build(), [recorded(), recorded(**BAR)]))
    values = {name: parameter.value for name, parameter in model.parameters.items()}
    assert math.sqrt(values["k"] / values["m"]) / (2 * math.pi) == pytest.approx(90.0)
    assert (values["b"], values["l"], values["m"]) == (0.2, 0.05, 0.03)
    of_bar = bar_of(build_model("play"), [recorded(**BAR)])
    mass = build_model("play").parameters["m"].value
    assert of_bar["b"] / (2 * math.sqrt(of_bar["k"] * mass)) == pytest.approx(0.03)
    assert bar_of(build_model("servo"), [recorded(**BAR)]) == {}
    assert bar_of(build_model("play"), [recorded()]) == {}


@pytest.mark.parametrize("value", ["ninety", -1.0, True, math.nan])
def test_a_bar_that_cannot_be_is_refused(value: object) -> None:
    """In one line, with the recording and the key."""
    with pytest.raises(ExperimentError, match=r"elbow\.csv: # f_res_hz: found .*, expected a positive number"):
        bar_of(build_model("play"), [recorded(f_res_hz=value)])
