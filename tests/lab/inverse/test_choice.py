"""What a search of smooth motions chooses by: what judges of a recording, the band, the effect that is named."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from lostmotion.drivers.recording import Recording
from lostmotion.lab.data.experiment import Experiment, experiments
from lostmotion.lab.inverse import candidates
from lostmotion.lab.inverse.signals import Signals
from lostmotion.lab.selection import evidence
from lostmotion.lab.selection.forward import named
from lostmotion.model import build_model
from tests.lab.inverse.test_inverse import explained

ONE, TWO = "coulomb_friction", "gravity_torque"
"""Effects with as many parameters."""


JOINT: Any = SimpleNamespace(turns=0.0, predictions=lambda one, other, of_all: SimpleNamespace(usual=1.0))


def candidate(effect: str, gain: float, count: int, blocks: int) -> Any:
    """A candidate that takes this share of the squared error of so many blocks, with so many parameters."""
    fit = SimpleNamespace(count=count, rms=1.0, model=build_model("joint"))
    return evidence.Candidate(effect, fit, gain, 0.0, blocks)


@pytest.mark.parametrize(("gain", "count", "expected"), [(0.71, 2, TWO), (0.42, 2, ONE), (0.71, 10, ONE)])
def test_parameters_are_worth_what_they_explain(gain: float, count: int, expected: str) -> None:
    """Of effects that twelve blocks hardly tell apart a second parameter is worth a fifth of the squared error: 42 %
    beside 38 are none, 71 % are, but not with ten parameters."""
    alike = [candidate(ONE, 0.38, 1, 12), candidate(TWO, gain, count, 12)]
    assert named(alike, JOINT).effect == expected


def test_rare_effects_pay_for_more_and_cost_the_others_less() -> None:
    """A spring has a hundredth of the weight's prior odds where that is a candidate or in the model, and all of them
    on an axis along a line."""
    common = ["viscous_friction", "coulomb_friction"]
    assert evidence.prior_odds([*common, "spring_torque"], []) == dict.fromkeys([*common, "spring_torque"], 1.0)
    beside = evidence.prior_odds([*common, "gravity_torque", "spring_torque"], [])
    assert beside == {**dict.fromkeys([*common, "gravity_torque"], 1.0), "spring_torque": 0.01}
    assert evidence.prior_odds(["spring_torque"], ["gravity_torque"]) == {"spring_torque": 0.01}


@pytest.mark.parametrize(("gain", "expected"), [(0.90, TWO), (0.99, "spring_torque")])
def test_of_a_weight_and_a_spring_the_likelier_one(gain: float, expected: str) -> None:
    """A spring that leaves a little less than a weight, with one parameter less, is not named; one that leaves a tenth
    of it is."""
    alike = [candidate("spring_torque", gain, 1, 40), candidate(TWO, 0.89, 2, 40)]
    assert named(alike, JOINT).effect == expected


def resting(seconds_at_rest: float) -> Experiment:
    """A joint that moves for ten seconds and then rests, 100 samples a second."""
    rng = np.random.default_rng(4)
    t = np.arange(0, 10 + seconds_at_rest, 0.01)
    angle = np.where(t < 10, np.sin(2 * np.pi * 0.5 * t), 0.0)
    torque = np.where(t < 10, -0.3 * np.sin(2 * np.pi * 0.5 * t), 0.0) + 1e-3 * rng.standard_normal(t.size)
    columns = {"position": angle + 1e-4 * rng.standard_normal(t.size), "torque": torque}
    (found,) = experiments(build_model("joint"), [Recording(t, columns, {}, name="rest.csv")])
    return found


@pytest.mark.parametrize("seconds", [0.0, 20.0])
def test_a_recording_is_split_by_its_motion(seconds: float) -> None:
    """Two thirds of the motion are over at the same time, however long the joint rests afterwards."""
    assert Signals.of(resting(seconds)).until_moved(2 / 3) == pytest.approx(6.7, abs=0.3)


def test_the_end_of_the_band_is_a_frequency() -> None:
    """A limit that lies above a recording's own band leaves it as it is, one below narrows it."""
    one = resting(0.0)
    own = Signals.of(one).band_hz
    assert Signals.of(one, most_hz=3 * own).band_hz == own
    assert Signals.of(one, most_hz=own / 2).band_hz == pytest.approx(own / 2)


def rung(seed: int, offset: float) -> Recording:
    """A bar of 20 Hz that rings down, damping ratio 0.01, by an accelerometer with an offset: in closed form."""
    rng = np.random.default_rng(seed)
    t = np.arange(0, 3, 1 / 400)
    w, zeta = 2 * np.pi * 20, 0.01
    wave = np.exp(-zeta * w * t) * np.cos(w * np.sqrt(1 - zeta**2) * t + rng.uniform(0, 6))
    return Recording(t, {"accel": 5 * wave + offset + 0.02 * rng.standard_normal(t.size)}, {}, name=f"rung{seed}.csv")


@pytest.mark.slow
@pytest.mark.parametrize("offset", [0.0, 4.4])
def test_an_offset_of_the_accelerometer_is_no_effect(offset: float, tmp_path: Path) -> None:
    """What an accelerometer adds to its readings, gravity or its own, is fitted: nothing is missing, noise is left."""
    answer = explained(tmp_path, 'base = "oscillator"\n', [rung(1, offset), rung(2, offset)])
    assert answer["verdict"] == "nothing_missing"
    assert answer["error"]["after"] == pytest.approx(0.02, rel=0.15)


def test_a_speed_at_which_friction_changes_is_one_of_the_motion() -> None:
    """Below a fiftieth of the usual speed a joint rests: there a Stribeck friction may be anything, and was 35 N m of a
    wrist whose motor gave 0.4."""
    model = build_model("joint", ["stribeck_friction"])
    size: Any = SimpleNamespace(speed=0.3)
    speed = candidates._above_noise(model, "stribeck_friction", size).parameters["stribeck_friction.omega_s"]
    assert speed.low == pytest.approx(0.006)
    assert speed.low <= speed.value <= speed.high


def test_a_play_is_larger_than_the_range_of_the_noise() -> None:
    """Noise crosses a smaller one at rest.  The presliding distance of a rival is free."""
    size: Any = SimpleNamespace(speed=0.3, noise=1e-4)
    plays = candidates._above_noise(build_model("joint", ["friction_behind_play"]), "friction_behind_play", size)
    assert plays.parameters["friction_behind_play.e"].low == pytest.approx(6e-4)
    rival = build_model("joint", ["presliding_friction"])
    assert candidates._above_noise(rival, "presliding_friction", size).parameters == rival.parameters
