"""Inertia, damping and stiffness straight from the spectra, against motions that SciPy integrates."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from lostmotion.drivers.recording import Recording
from lostmotion.lab.data.experiment import experiments
from lostmotion.lab.data.frequency_response import from_spectra
from lostmotion.model import build_model
from lostmotion.model.motion import FloatArray

TIMES = np.arange(1600) / 800


def driven(torque: FloatArray, J: float, b: float, tau_g: float) -> FloatArray:
    """theta of J theta'' = tau(t) - b theta' - tau_g sin theta, begun in motion."""

    def moved(t: float, state: FloatArray) -> list[float]:
        return [state[1], (np.interp(t, TIMES, torque) - b * state[1] - tau_g * np.sin(state[0])) / J]

    return np.asarray(solve_ivp(moved, (0, TIMES[-1]), [0.3, 3.0], t_eval=TIMES, rtol=1e-9, max_step=5e-3).y[0])


@pytest.mark.parametrize("tau_g", [0.0, 2e-3, -2e-3])
def test_neither_drift_nor_weight_is_inertia(tau_g: float) -> None:
    """A joint that turns on and on, with a weight that the model does not have: J within 2 % and b within 10 %, from
    a model that is ten times off."""
    rng = np.random.default_rng(5)
    torque = 4e-3 * sum(np.sin(2 * np.pi * f * TIMES + rng.uniform(-3, 3)) for f in (0.6, 1.7, 2.9))
    angle = driven(torque, 4e-4, 2e-4, tau_g)
    assert np.ptp(angle) > 3
    columns = {"torque": torque, "position": angle + rng.normal(0, 3e-4, angle.size)}
    model = build_model("joint", ["viscous_friction"], {"J": 4e-3})
    found = from_spectra(model, experiments(model, [Recording(TIMES, columns, name="turning.csv")]))
    assert found.parameters["J"].value == pytest.approx(4e-4, rel=0.02)
    assert found.parameters["viscous_friction.b_v"].value == pytest.approx(2e-4, rel=0.1)
