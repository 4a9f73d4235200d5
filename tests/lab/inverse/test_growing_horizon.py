"""What a fit on a longer horizon begins with."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from lostmotion.lab.comparison.compare import compare
from lostmotion.lab.data.experiment import Experiment
from lostmotion.lab.inverse.candidates import _not_vanished
from lostmotion.lab.inverse.fitted import fit_on
from lostmotion.lab.inverse.output_error import OutputError
from lostmotion.lab.inverse.regression import regressed
from lostmotion.lab.inverse.signals import Signals
from lostmotion.lab.shooting.parameters import free_names, held
from lostmotion.model import Model, build_model

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


WEIGHT, DRAG, COULOMB, NOISE = 37.2, 3e-3, 0.05, 4e-3
"""by the inertia [1/s², 1/rad, rad/s²], and rad"""


def swing(seed: int) -> Signals:
    """A pendulum that is filmed for 130 swings, from the middle of one on, by SciPy's LSODA."""
    rng, times = np.random.default_rng(seed), np.arange(0.0, 140.0, 0.02)
    found = solve_ivp(
        lambda _, y: [
            y[1], -WEIGHT * np.sin(y[0]) - DRAG * y[1] * abs(y[1]) - COULOMB * np.tanh(y[1] / 0.02)
        ], (0.0, 140.0), [rng.uniform(1.2, 1.6), rng.uniform(-4, 4)], "LSODA", times, rtol=1e-9, atol=1e-10,
    )  # fmt: skip
    angle = found.y[0] + NOISE * rng.standard_normal(times.size)
    return Signals.of(Experiment(f"swing{seed}.csv", None, times, {"position": angle}))


def pendulum(off: float = 1.0) -> Model:
    """That pendulum, with all parameters held; off: factor of the weight."""
    model = build_model("joint", ["gravity_torque", "quadratic_damping", "coulomb_friction"])
    inertia = model.parameters["J"].value
    sizes = {"gravity_torque.tau_g": off * WEIGHT, "quadratic_damping.b2": DRAG, "coulomb_friction.tau_c": COULOMB}
    known = model.replace({name: inertia * value for name, value in sizes.items()})
    return held(known, free_names(known))


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "off", "left"), [(0, 1.0, NOISE), (3, 1.0, NOISE), (0, 1.003, 0.06), (3, 0.995, 0.1)])
def test_initial_state_of_many_large_swings(seed: int, off: float, left: float) -> None:
    """The period depends on the amplitude: a fit to the whole begins with the speed of a filtered angle near its end,
    which is off by 2 rad/s, and ends a swing behind, with 0.65 to 0.8 rad left.  left: what may be left [rad]."""
    known = pendulum(off)
    there = fit_on(regressed(known, OutputError.of([swing(7)], known)), swing(seed))
    assert there is not None
    assert there.rms < 1.1 * left


@pytest.mark.parametrize("seed", [0, 3])
def test_many_large_swings_are_compared_from_the_first_on(seed: int) -> None:
    """``lab compare`` follows them as well."""
    found = compare(pendulum(), [swing(seed).experiment], is_described=False)
    assert found.rms("position") < 1.1 * NOISE
