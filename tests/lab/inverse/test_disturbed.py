"""Joints that their neighbours move: a slow torque that no effect of the joint explains is larger than its friction.
Closed forms of prescribed motions, written apart from the simulator."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lostmotion.drivers.recording import Recording
from lostmotion.lab.data.experiment import experiments
from lostmotion.lab.inverse import explain as search
from lostmotion.lab.inverse.fitted import is_noise
from lostmotion.lab.inverse.problem import InverseModel
from lostmotion.lab.inverse.regression import generalised, regressed
from lostmotion.lab.inverse.signals import Signals
from lostmotion.lab.selection.forward import selected
from lostmotion.model import build_model
from tests.lab.inverse.test_inverse import explained

BARE = 'base = "joint"\n'
INERTIA, COULOMB = 0.05, 0.25


def led(seed: int, coulomb: float, coupling: float) -> Recording:
    """A joint led along three sines for 25 s, 50 samples a second, while torques of its neighbours act, three sines of
    other frequencies [N m]; its friction changes sign at once."""
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, 25.0, 0.02)
    angle, speed, acceleration, neighbours = (np.zeros(time.size) for _ in range(4))
    for size in (0.5, 0.3, 0.2):
        rate, phase = 2 * math.pi * rng.uniform(0.05, 0.3), rng.uniform(0, 2 * math.pi)
        angle += size * np.sin(rate * time + phase)
        speed += size * rate * np.cos(rate * time + phase)
        acceleration -= size * rate**2 * np.sin(rate * time + phase)
        neighbours += coupling * size * np.sin(2 * math.pi * rng.uniform(0.05, 0.3) * time + rng.uniform(0, 6))
    torque = INERTIA * acceleration + coulomb * np.sign(speed) + neighbours
    columns = {
        "position": angle + 1e-4 * rng.standard_normal(time.size),
        "torque": torque + 0.05 * rng.standard_normal(time.size),
    }
    return Recording(time, columns, {}, {}, 0, f"led{seed}.csv")


def test_the_steps_of_dry_friction_are_seen_beside_slow_torques() -> None:
    """Generalised least squares is off by less than half as much as least squares, in the mean over six motions."""
    model = build_model("joint", ["coulomb_friction"])
    plain, white = [], []
    for one in experiments(model, [led(seed, COULOMB, 2.0) for seed in range(20, 26)]):
        fit = regressed(model, InverseModel.of([Signals.of(one, is_disturbed=True)], model))
        plain.append(abs(fit.model.parameters["coulomb_friction.tau_c"].value - COULOMB))
        white.append(abs(generalised(fit).model.parameters["coulomb_friction.tau_c"].value - COULOMB))
    assert np.mean(white) < 0.5 * np.mean(plain), (white, plain)
    assert np.median(white) < 0.2 * COULOMB, white


@pytest.mark.slow
def test_friction_of_a_joint_that_its_neighbours_move(tmp_path: Path) -> None:
    """Coulomb friction of an eighth of these torques is named (in 60 % of thirty such motions, in none without
    whitening), and none where there is none (10 % of thirty)."""

    def named(seed: int, coulomb: float) -> list[str]:
        (tmp_path / str(seed)).mkdir()
        return list(explained(tmp_path / str(seed), BARE, [led(seed, coulomb, 2.0)])["missing"])

    assert named(32, COULOMB) == ["coulomb_friction"]
    assert named(43, 0.0) == []


def test_what_predicts_the_last_recording_worse_is_not_preferred_as_it_is_whitened(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A whitened search that drops the last effect of the plain one, with which the last recording is predicted better,
    does not count."""
    searches: list[tuple[str, ...]] = []

    def searched(likelihood: Any, progress: Any, begun: Any = None) -> Any:
        found = selected(likelihood, progress) if begun is None else replace(begun, fits=begun.fits[:-1], added=())
        searches.append(found.added)
        return found

    monkeypatch.setattr(search, "selected", searched)
    monkeypatch.setattr(search, "is_disturbed", lambda fit: True)
    assert explained(tmp_path, BARE, [led(20, COULOMB, 0.0)])["missing"] == ["coulomb_friction"]
    assert searches == [("coulomb_friction",), ()]


def test_a_constant_residual_is_no_noise() -> None:
    """A motor that turns at a steady speed leaves nothing else of a friction that is missing."""
    rng = np.random.default_rng(0)
    noise = 1e-3 * rng.standard_normal(1000)
    assert is_noise(noise, 1e-3)
    assert not is_noise(noise + 0.03, 1e-3)
