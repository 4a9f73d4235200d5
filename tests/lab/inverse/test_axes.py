"""Axes along a line, springs and shafts that turn: motions in closed form or by SciPy, not by the lab's solver."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from lostmotion.drivers.recording import Recording
from lostmotion.lab.data.blocks import chance, family_wise
from lostmotion.lab.data.experiment import experiments
from lostmotion.lab.inverse.problem import InverseModel
from lostmotion.lab.inverse.regression import regressed
from lostmotion.lab.inverse.signals import Signals
from lostmotion.lab.quantity import of_axis
from lostmotion.lab.selection.evidence import Candidate
from lostmotion.lab.selection.forward import named
from lostmotion.model import build_model
from tests.lab.inverse.test_inverse import explained


def damper(seed: int, seconds: float = 5.0) -> Recording:
    """A damper with a gas spring that a table moves by up to 60 mm: force by displacement and speed in closed form."""
    rng = np.random.default_rng(seed)
    t = np.arange(0, seconds, 1 / 300)
    w, phase = 2 * np.pi * rng.uniform(0.3, 1.5, 3), rng.uniform(0, 6, 3)
    place = 0.02 * np.sin(np.multiply.outer(t, w) + phase).sum(-1)
    speed = 0.02 * (w * np.cos(np.multiply.outer(t, w) + phase)).sum(-1)
    force = 800 * speed + 40 * np.tanh(speed / 2e-3) + 1500 * place + 12 + 2 * rng.standard_normal(t.size)
    columns = {"position": place + 2e-6 * rng.standard_normal(t.size), "torque": force}
    return Recording(t, columns, {"position_unit": "m"}, name=f"damper{seed}.csv")


def swing(seed: int, is_wire: bool, start: float) -> Recording:
    """A free swing of 1 rad/s² per radian times seven: of a wheel on a wire, or of a weight."""
    times = np.arange(0.0, 9.0, 0.02)
    law = solve_ivp(
        lambda t, x: [x[1], -7.0 * (x[0] if is_wire else np.sin(x[0])) - 0.08 * x[1]], (0, 9), [start, 0.0], "DOP853",
        times, rtol=1e-9, atol=1e-11,
    )  # fmt: skip
    angle = law.y[0] + 1e-3 * start * np.random.default_rng(seed).standard_normal(times.size)
    return Recording(times, {"position": angle}, {}, name=f"swing{seed}.csv")


@pytest.mark.slow
def test_a_damper_with_a_gas_spring(tmp_path: Path) -> None:
    """Of a linear axis a spring is found beside viscous and dry friction, and no weight; its stiffness is right."""
    answer = explained(tmp_path, 'base = "joint"\n', [damper(1), damper(2), damper(3)])
    assert set(answer["missing"]) == {"viscous_friction", "coulomb_friction", "spring_torque"}
    assert answer["parameters"]["spring_torque.k_s"][0] == pytest.approx(1500, rel=0.03)
    assert of_axis("N m/rad", True) == "N/m"
    assert of_axis("N m s/rad", False, "A") == "A s/rad"
    assert of_axis("kg m^2", False, "A") == "A s^2/rad"


@pytest.mark.slow
@pytest.mark.parametrize(("is_wire", "start", "first"), [(True, 1.2, "spring_torque"), (False, 0.05, "gravity_torque")])
def test_a_wire_and_a_weight(is_wire: bool, start: float, first: str, tmp_path: Path) -> None:
    """A wheel on a wire swings large and small in the same time, a weight does not; where the swing is too small to
    tell them apart, the likelier weight is named, and the spring as what cannot be told from it."""
    rings = [swing(seed, is_wire, start * (1 - 0.2 * seed)) for seed in range(2)]
    answer = explained(tmp_path, 'base = "joint"\n', rings)
    assert set(answer["missing"]) == {first, "viscous_friction"}
    alike = [group for group in answer["confusable"] if group[0] == first]
    assert is_wire or "spring_torque" in alike[0]


@pytest.mark.parametrize(("turns", "first"), [(3.0, "gravity_torque"), (12.0, "torque_ripple")])
def test_a_weight_and_what_repeats_once_a_turn(turns: float, first: str) -> None:
    """They are one function: of a pendulum that was swung up over three turns the weight is named, of a shaft that
    turns twelve times the ripple."""
    alike: list[Any] = [
        Candidate(name, SimpleNamespace(count=2, rms=1.0, model=build_model("joint", [name])), 0.9, 0.0, 40)
        for name in ("torque_ripple", "gravity_torque")
    ]
    equal = SimpleNamespace(usual=1.0)
    likelihood: Any = SimpleNamespace(turns=turns, predictions=lambda one, other, of_all: equal)
    best = named(alike, likelihood)
    assert best.effect == first


def test_a_constant_torque_is_no_larger_than_what_was_measured() -> None:
    """A torque that is a parabola of five degrees of angle is no ripple of once a turn: the constant torque would have
    to be hundreds of times as large as all that was measured."""
    t = np.arange(0, 10, 0.01)
    angle = 0.08 * np.sin(2 * np.pi * 0.4 * t)
    columns = {
        "position": angle,
        "torque": 10 * (angle / 0.08) ** 2 + 1e-3 * np.random.default_rng(1).standard_normal(t.size),
    }
    model = build_model("joint", ["torque_ripple"], {"torque_ripple.N": 1, "torque_ripple.phi": 1.5})
    (one,) = experiments(model, [Recording(t, columns, {}, name="parabola.csv")])
    fit = regressed(model, InverseModel.of([Signals.of(one)], model))
    assert abs(fit.model.parameters["bias"].value) <= 2.001 * 10
    assert abs(fit.model.parameters["torque_ripple.tau_r"].value) < 50


def test_blocks_of_noise_alone_do_not_outvote_the_others() -> None:
    """Nine blocks of next to no error, of which another model leaves a thousandth, and three whose error it makes
    ten times as large: the quiet ones do not decide."""
    quiet, loud = np.full(90, 1e-6), np.full(30, 100.0)
    one, other = np.concatenate([quiet, loud]), np.concatenate([1e-3 * quiet, 10 * loud])
    assert chance(one, other, np.repeat(np.arange(12), 10)) > 0.5


def test_what_cannot_be_simulated_predicts_worse() -> None:
    """Infinite errors are larger than any, in each block."""
    after = np.random.default_rng(3).chisquare(1, 120)
    assert chance(np.full(120, np.inf), after, np.repeat(np.arange(12), 10)) == 0.0


def test_one_block_tells_nothing() -> None:
    """A single block has no scatter to compare its difference with."""
    one, other, block = np.full(10, 1.0), np.full(10, 0.5), np.zeros(10, dtype=int)
    assert chance(one, other, block) == 1.0
    assert family_wise([(one, other)], [1.0], block, 0.05) == 1.0


@pytest.mark.slow
def test_a_recording_of_less_than_a_second_has_an_answer(tmp_path: Path) -> None:
    """Of a single stroke something that brakes is named, and nothing fails for want of a whole second."""
    answer = explained(tmp_path, 'base = "joint"\n', [damper(5, 0.7)])
    assert set(answer["missing"][:1]) <= {"viscous_friction", "quadratic_damping", "coulomb_friction"}
    assert answer["verdict"] == "missing"
