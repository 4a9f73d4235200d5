"""What a fit on a longer horizon begins with."""

from __future__ import annotations

import pytest

from lostmotion.lab.inverse.candidates import _not_vanished
from lostmotion.model import build_model

EFFECTS = ["gravity_torque", "coulomb_friction"]
FIRST = {"gravity_torque.tau_g": 6e-3, "gravity_torque.phi": 0.07, "coulomb_friction.tau_c": 6e-5}


@pytest.mark.parametrize("phase", [0.07, 1e-6, 0.0, -0.005])
def test_an_angle_passes_zero(phase: float) -> None:
    """Only what cannot be negative gets stuck at zero.  The rest of a weight began anew where a short horizon made it
    smaller than zero; a pendulum that falls from 2.8 rad was then fitted from another motion, and had no weight."""
    start = build_model("joint", EFFECTS, FIRST)
    found = start.replace({"gravity_torque.phi": phase})
    assert _not_vanished(found, start).parameters["gravity_torque.phi"].value == phase


@pytest.mark.parametrize(("left", "begins"), [(0.0, 6e-5), (1e-9, 6e-5), (1e-6, 1e-6)])
def test_a_size_that_vanished_begins_anew(left: float, begins: float) -> None:
    """A friction that a short horizon takes to zero stays there."""
    start = build_model("joint", EFFECTS, FIRST)
    found = start.replace({"coulomb_friction.tau_c": left})
    assert _not_vanished(found, start).parameters["coulomb_friction.tau_c"].value == begins
