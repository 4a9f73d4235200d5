"""Energy: the contact only takes it away, and the balance with the work of the command closes."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.integrate import simpson

from lostmotion.model import HandWaved, Model, Trajectory, build_model

FloatArray = NDArray[np.float64]
TIMES = np.arange(20001) * 5e-5


def energy(model: Model, trajectory: Trajectory) -> FloatArray:
    """Kinetic energy of the joint and elastic energy of the contact [J]."""
    v = {name: parameter.value for name, parameter in model.parameters.items()}
    half = v["d"] / 2
    elastic = v["beta"] * half / (v["n"] + 1) * (trajectory["gap"] / half) ** (v["n"] + 1)
    return v["J2"] / 2 * trajectory["velocity"] ** 2 + elastic


@settings(max_examples=15, deadline=None)
@given(
    speed=st.floats(0.05, 2.0),
    alpha=st.floats(0.0, 2e4),
    d=st.floats(1e-5, 5e-4),
    n=st.sampled_from([3, 11, 21]),
)
def test_the_contact_only_takes_energy(speed: float, alpha: float, d: float, n: int) -> None:
    """A joint thrown into its held gear never gains energy, whatever the contact."""
    model = build_model("play", (), {"alpha": alpha, "d": d, "n": n})
    thrown = model.simulate(None, TIMES[:4001], model.initial_state(omega_2=speed))
    left = energy(model, thrown)
    assert np.all(np.diff(left) <= 1e-4 * left[0])
    assert left[-1] <= left[0] * (1 + 1e-3)


def test_undamped_contact_keeps_energy() -> None:
    """Without alpha nothing is lost in dozens of impacts."""
    model = build_model("play", (), {"alpha": 0.0})
    left = energy(model, thrown := model.simulate(None, TIMES, model.initial_state(omega_2=0.3)))
    assert np.count_nonzero(np.diff(np.sign(thrown["velocity"]))) > 20
    assert np.max(np.abs(left / left[0] - 1)) < 1e-3


def test_balance_with_the_work_of_the_command() -> None:
    """Energy gained = work that gear 1 does on gear 2 minus alpha delta_v² X^(n+1) lost in the contact, to 1e-5."""
    model, motion = build_model("play"), HandWaved(seed=2)
    trajectory = model.simulate(motion, TIMES, substep_s=2.5e-5)
    v = {name: parameter.value for name, parameter in model.parameters.items()}
    gap_rate = v["R2"] * trajectory["velocity"] - v["R1"] * motion.velocity(TIMES)
    lost = simpson(v["alpha"] * gap_rate**2 * (2 * trajectory["gap"] / v["d"]) ** (v["n"] + 1), x=TIMES)
    work = simpson(-trajectory["force"] * v["R1"] * motion.velocity(TIMES), x=TIMES)
    gained = energy(model, trajectory)
    turnover = simpson(np.abs(trajectory["force"] * v["R1"] * motion.velocity(TIMES)), x=TIMES)
    assert lost > 1e-3 * turnover
    assert abs(gained[-1] - gained[0] - (work - lost)) < 1e-5 * turnover


def test_the_bar_rings_down() -> None:
    """The bar's energy only falls while the joint rests."""
    model = build_model("play")
    state = model.initial_state(q=1e-3)
    k, m = model.parameters["k"].value, model.parameters["m"].value
    states = model.simulate(None, TIMES, state).states
    q, q_rate = (states[:, model.state_names.index(name)] for name in ("q", "q'"))
    left = k / 2 * q**2 + m / 2 * q_rate**2
    assert np.all(np.diff(left) < 1e-9 * left[0])
    assert left[-1] < 1e-3 * left[0]
