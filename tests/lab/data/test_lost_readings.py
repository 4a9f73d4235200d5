"""Readings that a bus lost: told and left out, so that the physics is found; what a joint really does stays."""

from __future__ import annotations

import logging
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from lostmotion.drivers.recording import Recording
from lostmotion.lab.data.experiment import experiments
from lostmotion.lab.data.readings import lost_readings
from lostmotion.model import build_model
from lostmotion.model.motion import FloatArray
from tests.lab.inverse.test_inverse import explained

RATE, LENGTH = 50.0, 25.0
LOST = (40, 333, 700, 701, 702, 704, 1210)


def arm(seed: int, lost: tuple[int, ...] = LOST) -> Recording:
    """An arm of 0.05 kg m² with a weight of 0.5 N m and dry friction of 0.2 N m, moved by five sines of torque for
    25 s; a 12-bit encoder, whose lost readings are those of the count zero."""
    rng = np.random.default_rng(seed)
    size, hz, phase = rng.uniform(0.1, 0.25, 5), rng.uniform(0.1, 1.2, 5), rng.uniform(0, 2 * np.pi, 5)

    def torque(t: FloatArray | float) -> FloatArray:
        return np.asarray(np.sum(size * np.sin(2 * np.pi * np.multiply.outer(t, hz) + phase), -1))

    def moved(t: float, x: FloatArray) -> list[float]:
        return [x[1], float(torque(t) - 0.5 * np.sin(x[0]) - 0.2 * np.tanh(x[1] / 0.01) - 0.02 * x[1]) / 0.05]

    times = np.arange(0.0, LENGTH, 1 / RATE)
    angle = solve_ivp(moved, (0, LENGTH), [0.0, 0.0], "LSODA", times, rtol=1e-8, atol=1e-10).y[0]
    position = np.round(angle * 4096 / (2 * np.pi)) * 2 * np.pi / 4096
    position[list(lost)] = -np.pi
    return Recording(times, {"position": position, "torque": torque(times)}, name=f"arm{seed}.csv")


def test_lost_readings_are_told_and_left_out(caplog: pytest.LogCaptureFixture) -> None:
    """Single ones, three in a row, and one beside them; one line says how many."""
    with caplog.at_level(logging.WARNING, "lostmotion"):
        held = experiments(build_model("joint"), [arm(1)])[0]
    assert "7 of 1250 readings of position jump away" in caplog.text
    assert held.time.size == 1250 - len(LOST)
    assert np.abs(held.measured["position"]).max() < 3
    assert not set(np.arange(0.0, LENGTH, 1 / RATE)[list(LOST)]) & set(held.time)


def test_lost_readings_at_the_ends() -> None:
    """The first reading after switching on, and the last three."""
    angle = np.sin(np.arange(500) / 30)
    angle[0], angle[497:] = 7.0, -2.5
    assert np.flatnonzero(lost_readings(angle)).tolist() == [0, 497, 498, 499]


@pytest.mark.parametrize(
    "angle",
    [
        np.repeat([0.0, 1.0, 0.0, 2.0], 100),  # steps that stay
        np.sin(np.arange(2000) * 2.0),  # a sine of three samples a period
        np.r_[np.zeros(900), 1e-3 * np.tile([1.0, 0.0], 50)],  # rest on the edge of a count
        np.r_[np.zeros(980), np.sin(np.arange(20) / 19 * np.pi)],  # a push, else at rest
        np.where(np.arange(400) % 50 < 3, np.pi, -np.pi) + 0.01 * np.sin(np.arange(400)),  # an angle that wraps
        np.zeros(100),
        np.random.default_rng(0).standard_t(4, 20000),
    ],
    ids=["steps", "fast", "counts", "push", "wraps", "rest", "noise"],
)  # fmt: skip
def test_what_a_joint_does_stays(angle: FloatArray) -> None:
    """No reading of a motion, of an encoder's edge or of noise is taken for a lost one."""
    assert not lost_readings(angle).any()


@pytest.mark.slow
@pytest.mark.parametrize(("seeds", "lost"), [((1, 2), ()), ((3, 4), LOST)], ids=["all", "lost"])
def test_the_physics_of_an_arm_is_found(seeds: tuple[int, ...], lost: tuple[int, ...], tmp_path: Path) -> None:
    """Its weight and its dry friction, also with seven readings lost of each 1250.  It sticks at its reversals, which
    the filter blurs: that is no Stribeck friction."""
    found = explained(tmp_path, 'base = "joint"\n', [arm(seed, lost) for seed in seeds])
    assert set(found["missing"][:2]) == {"gravity_torque", "coulomb_friction"}
    values = {name: one[0] for name, one in found["parameters"].items()}
    assert values["coulomb_friction.tau_c"] == pytest.approx(0.2, rel=0.05)
    assert values["gravity_torque.tau_g"] == pytest.approx(0.5, rel=0.05)
