"""Dry friction that is elastic near every reversal, as in a damper, with a force that no effect explains.  Integrated
by SciPy, apart from the lab."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from lostmotion.drivers.recording import Recording
from lostmotion.lab.inverse.fitted import Fitted
from lostmotion.lab.inverse.regression import Regression
from lostmotion.model import build_model
from tests.lab.inverse.test_inverse import explained

MASS, DAMPING, FRICTION, STIFFNESS = 1.0, 300.0, 40.0, 80000.0
"""[kg], [N s/m], [N], [N/m]: the friction slips after half a millimetre; the motion is 20 mm."""


def damper(seed: int) -> Recording:
    """A damper that a testing machine moves irregularly for 20 s, 200 samples a second, and the force on it; what no
    effect explains, a slow drift of the force, is a fifth of it."""
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, 20.0, 0.005)
    rates, phases = 2 * np.pi * rng.uniform(0.3, 3.0, 8), rng.uniform(0, 2 * np.pi, 8)
    sizes = 0.012 / np.sqrt(1 + (rates / 6) ** 2)

    def speed(t: float) -> float:
        return float(np.sum(sizes * rates * np.cos(rates * t + phases)))

    def slip(t: float, force: np.ndarray) -> np.ndarray:
        v = speed(t)
        return np.asarray([STIFFNESS * v * (1 - force[0] / FRICTION * np.sign(v))])

    dry = solve_ivp(slip, (0, time[-1]), [0.0], method="LSODA", t_eval=time, rtol=1e-6, max_step=0.005).y[0]
    angles = np.outer(time, rates) + phases
    velocity, acceleration = np.cos(angles) @ (sizes * rates), -np.sin(angles) @ (sizes * rates**2)
    slow = np.cumsum(rng.standard_normal(time.size)) * 0.25
    force = MASS * acceleration + DAMPING * velocity + dry + slow - slow.mean()
    position = np.sin(angles) @ sizes + 1e-6 * rng.standard_normal(time.size)
    columns = {"position": position, "torque": force + 0.3 * rng.standard_normal(time.size)}
    return Recording(time, columns, {"position_unit": "m"}, {}, 0, f"damper{seed}.csv")


def sized(friction: float, deviation: float) -> Regression:
    """What is asked of a fit of Coulomb friction with this size and standard deviation."""
    name = "coulomb_friction.tau_c"
    model = build_model("joint", ["coulomb_friction"], {name: friction})
    unknowns = SimpleNamespace(names=(name,))
    return cast(Regression, SimpleNamespace(model=model, unknowns=unknowns, deviations={name: deviation}, freedom=40))


def test_a_whitened_fit_that_disagrees_is_not_reported() -> None:
    """The sizes of a damper (31 standard deviations apart), where least squares predict better, and of a joint that its
    neighbours move, where the whitened fit is closer."""
    plain, white = sized(419.0, 11.0), sized(164.0, 6.0)
    assert Fitted(plain, white).surest is plain
    plain, white = sized(0.235, 0.137), sized(0.21, 0.041)
    assert Fitted(plain, white).surest is white


@pytest.mark.slow
def test_the_friction_of_a_damper_is_that_of_the_whole_band(tmp_path: Path) -> None:
    """It is named first beside the viscous friction, its size is right to a tenth, and it lowers the error."""
    model = 'base = "joint"\neffects = ["viscous_friction"]\n'
    found = explained(tmp_path, model, [damper(seed) for seed in (31, 32, 33)])
    assert found["missing"][0] == "coulomb_friction"
    assert found["error"]["after"] < 0.6 * found["error"]["before"]
    assert found["parameters"]["coulomb_friction.tau_c"][0] == pytest.approx(FRICTION, rel=0.1)
