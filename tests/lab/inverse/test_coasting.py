"""Shafts that coast down: dry friction brakes them evenly, as a constant torque would, which nothing free has."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from lostmotion.drivers.recording import Recording
from lostmotion.lab.data.experiment import Experiment, experiments
from lostmotion.lab.fitting.identifiability import with_scale
from lostmotion.lab.inverse.release import released
from lostmotion.model import build_model
from lostmotion.model.motion import FloatArray
from tests.lab.inverse.test_inverse import explained

RATE_HZ, LENGTH_S, COUNT = 50.0, 24.0, 2 * np.pi / 2048
TIMES = np.arange(0.0, LENGTH_S, 1 / RATE_HZ)
UNBALANCE = 0.02  # torque of the weight over the inertia [rad/s²]


def turned(viscous: float, dry: float, released_s: float = 0.0, speed: float = 40.0) -> FloatArray:
    """The angle [rad] of a shaft that is driven at a speed [rad/s] until it is released, in counts of an encoder;
    viscous [1/s] and dry [rad/s²] friction over its inertia, by the solution of its equation."""
    after = np.clip(TIMES - released_s, 0.0, np.log1p(viscous * speed / dry) / viscous)
    fallen = (1 - np.exp(-viscous * after)) / viscous
    angle = speed * np.minimum(TIMES, released_s) + speed * fallen - dry / viscous * (after - fallen)
    return np.asarray(np.round(angle / COUNT) * COUNT)


@pytest.mark.slow
@pytest.mark.parametrize("dry", [1.0, 1.5])
def test_dry_friction_of_a_bearing_is_named(dry: float, tmp_path: Path) -> None:
    """Both frictions, right to 1 % (J is held at 0.0002 kg m²), each with its share of the error."""
    shaft = Recording(TIMES, {"position": turned(0.06, dry)}, name="shaft.csv")
    found = explained(tmp_path, 'base = "joint"\n', [shaft])
    assert set(found["missing"]) == {"viscous_friction", "coulomb_friction"}
    assert min(found["share"].values()) > 0.05  # of Coulomb friction 0, if a constant torque may be beside it
    assert found["parameters"]["coulomb_friction.tau_c"][0] == pytest.approx(2e-4 * dry, rel=0.01)
    assert found["parameters"]["viscous_friction.b_v"][0] == pytest.approx(2e-4 * 0.06, rel=0.01)


@pytest.mark.parametrize("released_s", [0.0, 3.0, 6.0])
def test_what_drives_it_first_is_left_out(released_s: float) -> None:
    """The release is found to a second, and all of the motion remains."""
    shaft = Experiment("shaft.csv", None, TIMES, {"position": turned(0.06, 1.5, released_s)})
    (found,) = released([shaft])
    assert 0.0 <= found.time[0] - released_s < 1.0
    assert found.measured["position"][-1] == pytest.approx(shaft.measured["position"][-1], abs=0.01)


def test_only_a_shaft_has_no_constant_torque() -> None:
    """Less than eight turns may be those of a door on a spring, whose rest is a part of the constant torque."""
    model = build_model("joint")
    for turns, is_held in ((20.0, True), (2.0, False)):
        angle = turned(0.06, 1.5) / turned(0.06, 1.5)[-1] * 2 * np.pi * turns
        (shaft,) = experiments(model, [Recording(TIMES, {"position": angle}, name="shaft.csv")])
        assert with_scale(model, [shaft])[0].parameters["bias"].fixed == is_held


@pytest.mark.slow
def test_a_small_weight_shows_beside_the_frictions_of_a_wheel(tmp_path: Path) -> None:
    """A wheel with viscous and dry friction whose unbalance is a twentieth of them: it changes the angle by a ten
    thousandth of what the friction does, and by ten times the noise.  A ripple of once a turn is the same torque."""

    def slope(_: float, state: FloatArray) -> list[float]:
        return [state[1], -0.01 * state[1] - 0.25 - UNBALANCE * np.sin(state[0] + 0.7)]

    times = np.arange(0.0, 34.0, 0.02)
    run = solve_ivp(slope, (0.0, times[-1]), [0.0, 13.0], "DOP853", times, rtol=1e-10, atol=1e-10)
    assert run.y[1].min() > 0.5  # it does not come to rest
    wheel = Recording(times, {"position": np.round(run.y[0] / COUNT) * COUNT}, name="wheel.csv")
    found = explained(tmp_path, 'base = "joint"\n', [wheel])
    assert {"viscous_friction", "coulomb_friction"} < set(found["missing"])
    assert {"torque_ripple", "gravity_torque"} & set(found["missing"])
    assert found["error"]["after"] < 3 * COUNT
