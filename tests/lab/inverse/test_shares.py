"""Effects that share a torque: what each of them gets."""

from __future__ import annotations

import numpy as np
import pytest

from lostmotion.drivers.recording import Recording
from lostmotion.lab.data.experiment import experiments
from lostmotion.lab.inverse.effect_sizes import is_sized, shares
from lostmotion.lab.inverse.problem import InverseModel
from lostmotion.lab.inverse.regression import regressed
from lostmotion.lab.inverse.signals import Signals
from lostmotion.model import build_model
from lostmotion.model.motion import FloatArray

TIMES = np.arange(0.0, 20.0, 0.01)


def of(angle: FloatArray, torque: FloatArray, **values: float) -> dict[str, float]:
    """The shares of a spring and viscous friction, and of a weight where it has a size, of this motion."""
    effects = ["spring_torque", "viscous_friction", *(["gravity_torque"] if "gravity_torque" in str(values) else [])]
    model = build_model("joint", effects, {name.replace("__", "."): value for name, value in values.items()})
    (held,) = experiments(model, [Recording(TIMES, {"position": angle, "torque": torque})])
    return shares(model, effects, [Signals.of(held)])


def test_a_spring_that_cancels_an_inertia_is_small() -> None:
    """Of one frequency, however stiff; of two frequencies it is as large as its torque."""
    one, two = np.sin(6 * TIMES), np.sin(6 * TIMES) + 0.7 * np.sin(17 * TIMES)
    known = {"J": 10.0, "spring_torque__k_s": 360.0, "viscous_friction__b_v": 5.0}
    found = of(one, np.cos(6 * TIMES), **known)
    assert found["spring_torque"] < 0.01 * found["viscous_friction"]
    found = of(two, np.cos(6 * TIMES), **known)
    assert found["spring_torque"] > 10 * found["viscous_friction"]


def test_a_weight_that_is_nearly_constant_is_small() -> None:
    """Of an arm that turns by a tenth of a radian at the side, where its weight hardly changes; the spring is first."""
    angle = 0.1 * np.sin(6 * TIMES) + 0.05 * np.sin(17 * TIMES)
    known = {"J": 1e-3, "spring_torque__k_s": 20.0, "viscous_friction__b_v": 0.1}
    found = of(angle, angle, **known, gravity_torque__tau_g=9.0, gravity_torque__phi=np.pi / 2)
    assert found["gravity_torque"] < 0.01 * found["spring_torque"]


@pytest.mark.parametrize("near_rest", [0.3, 0.6])
def test_a_law_that_does_not_differ_from_its_simpler_part_has_no_size(near_rest: float) -> None:
    """Dry friction of 0.3 N m, and of twice as much below 0.5 rad/s: only the second is Stribeck friction, as both
    sizes of that differ from zero in the first one, too."""
    angle, noise = np.sin(3 * TIMES) + 0.5 * np.sin(1.7 * TIMES), np.random.default_rng(1).normal(size=TIMES.size)
    speed, acceleration = np.gradient(angle, TIMES), np.gradient(np.gradient(angle, TIMES), TIMES)
    dry = 0.3 + (near_rest - 0.3) * np.exp(-((speed / 0.5) ** 2))
    torque = 0.02 * acceleration + dry * np.sign(speed) + 0.05 * noise
    model = build_model("joint", ["stribeck_friction"], {"stribeck_friction.omega_s": 0.5})
    (held,) = experiments(model, [Recording(TIMES, {"position": angle, "torque": torque})])
    fit = regressed(model, InverseModel.of([Signals.of(held)], model))
    assert fit.model.parameters["stribeck_friction.tau_c"].value == pytest.approx(0.3, rel=0.1)
    assert is_sized("stribeck_friction", fit) is (near_rest > 0.3)
