"""A joint that moves in a third of a short recording: what rests knows nothing of its friction."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from lostmotion.lab.data.experiment import Experiment
from lostmotion.lab.explanation import explain
from lostmotion.lab.parallel import open_executor
from lostmotion.model import Sampled, build_model
from lostmotion.model.motion import FloatArray

RATE_HZ, LENGTH_S, FRICTION = 25.0, 16.0, 0.3


def moved(seed: int) -> Experiment:
    """Four moves of a controlled joint with dry friction of 0.3 N m, each followed by a rest, by SciPy's LSODA."""
    rng = np.random.default_rng(seed)
    times = np.arange(0.0, LENGTH_S, 1 / RATE_HZ)
    goal = np.zeros_like(times)
    for move in range(4):
        part = np.clip((times - move * LENGTH_S / 4 - 0.5) / (0.09 * LENGTH_S), 0, 1)
        goal += rng.uniform(0.5, 1.5) * (-1) ** move * (10 * part**3 - 15 * part**4 + 6 * part**5)

    def torque(t: float, y: FloatArray) -> float:
        return 60.0 * (float(np.interp(t, times, goal)) - y[0]) - 1.5 * y[1]

    def slope(t: float, y: FloatArray) -> list[float]:
        return [y[1], (torque(t, y) - 0.05 * y[1] - FRICTION * np.tanh(y[1] / 0.004)) / 0.02]

    found = solve_ivp(slope, (0, LENGTH_S), [0, 0], "LSODA", times, rtol=1e-8, atol=1e-10, max_step=0.05)
    given = np.array([torque(t, y) for t, y in zip(times, found.y.T, strict=True)])
    angle = found.y[0] + rng.normal(0, 2e-4, times.size)
    return Experiment(
        f"{seed}.csv", Sampled(times, given + rng.normal(0, 0.01, times.size)), times, {"position": angle}
    )


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 3])
def test_dry_friction_of_a_joint_that_rests_longer_than_it_moves(seed: int) -> None:
    """A third of a hundred samples move.  With all of them it was a Stribeck friction, beside a weight that is not
    there."""
    with open_executor("threads:1") as pool:
        found = explain(build_model("joint"), [moved(seed), moved(seed + 1)], pool)
    assert found.missing[0] == "coulomb_friction"
    assert not {"stribeck_friction", "gravity_torque"} & set(found.missing)
    assert found.best["coulomb_friction.tau_c"].value == pytest.approx(FRICTION, rel=0.1)
