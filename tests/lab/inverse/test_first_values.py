"""Where a fit with one more effect begins."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from lostmotion.drivers.recording import Recording
from lostmotion.lab import experiments
from lostmotion.lab.inverse.candidates import sizes_of
from lostmotion.lab.inverse.first_values import _possible, guesses, initial_point
from lostmotion.lab.inverse.free_parameters import Objective, possible
from lostmotion.lab.inverse.output_error import OutputError
from lostmotion.lab.inverse.regression import Regression, regressed
from lostmotion.lab.inverse.signals import Signals
from lostmotion.lab.shooting.initial_guess import initial_guesses
from lostmotion.lab.shooting.parameters import held
from lostmotion.model import build_model
from lostmotion.model.motion import FloatArray

WEIGHT, DRY, DRAG, J = 40.3, 0.046, 0.0032, 2e-4
"""of a pendulum of 80 s, over its inertia, and the inertia [kg m²]"""


@pytest.fixture(scope="module")
def swing() -> Recording:
    """A pendulum with dry friction and drag, by SciPy's Radau."""

    def slope(_: float, x: FloatArray) -> list[float]:
        return [x[1], -WEIGHT * np.sin(x[0]) - DRY * np.tanh(x[1] / 0.01) - DRAG * x[1] * abs(x[1])]

    time = np.arange(0.0, 80.0, 0.01)
    angle = solve_ivp(slope, (0.0, 80.0), [1.2, 0.0], "Radau", time, rtol=1e-8, atol=1e-9).y[0]
    noise = 1e-3 * np.random.default_rng(5).standard_normal(time.size)
    return Recording(time, {"position": angle + noise}, name="swing.csv")


def fitted(swing: Recording, viscous: float) -> Regression:
    """With viscous friction in the place of both, beside a dry friction of zero."""
    effects = ["gravity_torque", "viscous_friction", "coulomb_friction"]
    values = {"gravity_torque.tau_g": WEIGHT * J, "viscous_friction.b_v": viscous * J, "coulomb_friction.tau_c": 0.0}
    model = held(build_model("joint", effects, {**values, "J": J}), ["J", "bias"])
    data = OutputError.of([Signals.of(one) for one in experiments(model, [swing])], model)
    return regressed(model, data, data.nuisance, 30)


@pytest.mark.slow
def test_drag_beside_a_friction_of_zero_begins_no_worse_than_without_it(swing: Recording) -> None:
    """Both take the place of viscous friction, of which less is then needed: the first step leaves less than the fit
    without drag, and dry friction, which cannot be smaller than zero, is no part of it."""
    now = fitted(swing, 0.025)
    wide = now.model.with_effect("quadratic_damping")
    begin = [wide.replace(values) for values in initial_guesses(wide, "quadratic_damping", sizes_of(now))]
    best = guesses("quadratic_damping", begin, now, now.data)[0]
    model, nuisance = initial_point("quadratic_damping", best, now, now.data)
    error = float(np.sqrt(np.mean(now.data.residual(model, nuisance) ** 2)))
    assert error <= now.rms * (1 + 1e-6)
    assert model.parameters["coulomb_friction.tau_c"].value >= 0


@pytest.mark.parametrize(("times", "is_possible"), [(1e-3, True), (8.0, True), (15.0, False), (1e5, False)])
def test_no_fit_begins_with_an_impossible_torque(times: float, is_possible: bool, swing: Recording) -> None:
    """A dry friction that holds the pendulum at rest knows no size, and is simulated in steps of its change of sign."""
    data = fitted(swing, 0.025).data
    largest = J * float(np.abs(data.signals[0].acceleration).max())
    model = build_model("joint", ["coulomb_friction"], {"coulomb_friction.tau_c": times * largest, "J": J})
    assert bool(_possible([(model, data.nuisance)], ["coulomb_friction.tau_c"], data)) is is_possible


@pytest.mark.slow
@pytest.mark.parametrize(("factor", "is_simulated"), [(1.0, True), (100.0, True), (1e5, False)])
def test_no_step_asks_for_an_impossible_torque(factor: float, is_simulated: bool, swing: Recording) -> None:
    """A step of a fit to a wheel that coasts asked for 1e11 times the torque of its inertia, and the stiff motion took
    40 s to simulate.  It counts as one that cannot be simulated, whatever the inertia of the file is."""
    now = fitted(swing, 0.05)
    usual = now.data.signal_rms(now.model)
    weight = np.zeros(now.count)
    high = np.full(now.count + now.nuisance.size, np.inf)
    most = possible(now.unknowns, now.model, now.data)
    objective = Objective(now.model, now.data, now.unknowns, usual, weight, weight, high, most)
    z = np.concatenate([now.z, now.nuisance])
    objective.jacobian(z)
    at = now.unknowns.names.index("coulomb_friction.tau_c")
    item = now.unknowns.items[at]
    torque = factor * J * max(float(np.abs(one.acceleration).max()) for one in now.data.signals)
    z[at] = item.z(torque)
    assert np.isfinite(objective.residual(z)).all() == is_simulated
