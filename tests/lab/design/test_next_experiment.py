"""Advice on what to record: simulated from the competing models, so that a recording made after it does tell."""

from __future__ import annotations

import re
import warnings
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from lostmotion.drivers.recording import Recording
from lostmotion.lab.data.experiment import experiments
from lostmotion.lab.deadline import within
from lostmotion.lab.design.next_experiment import what_to_record
from lostmotion.lab.shooting.task import Task
from lostmotion.model import Model, Sampled, build_model, by_name

NOISE = 5e-4


@cache
def task() -> Task:
    """A servo that rubs, moved by hand for six seconds."""
    truth = build_model("servo", ["coulomb_friction"], {"coulomb_friction.tau_c": 0.15})
    times = np.arange(600) / 100
    run = truth.simulate(by_name("hand-waved:1"), times)
    position = run["position"] + NOISE * np.random.default_rng(0).standard_normal(times.size)
    recording = Recording(times, {"command": run["command"], "position": position}, name="rec.csv")
    return Task.of(truth, experiments(truth, [recording]), {"position": NOISE})


def advised(*models: Model) -> str:
    """The advice for these models."""
    with ThreadPoolExecutor(2) as pool:
        return what_to_record(models, task(), pool)


def rubbing(effect: str, **values: float) -> Model:
    """The servo with one kind of friction."""
    return build_model("servo", [effect], {f"{effect}.{name}": value for name, value in values.items()})


@pytest.mark.slow
def test_names_a_motion_that_tells_more() -> None:
    """Two frictions that differ near rest only: the motion advised separates them further than the recorded one."""
    coulomb = rubbing("coulomb_friction", tau_c=0.15)
    stribeck = rubbing("stribeck_friction", tau_c=0.15, tau_s=0.2, omega_s=0.1)
    text = advised(coulomb, stribeck)
    assert text.startswith("Record ")
    assert "Coulomb friction and Stribeck friction" in text
    there, here = map(float, re.findall(r"by (\d+\.?\d*)", text))
    assert there > 1.5 * here > 0


def test_models_that_act_alike_are_not_distinguished() -> None:
    """A Stribeck friction whose two levels are equal is Coulomb's: no motion is promised to tell."""
    alike = rubbing("stribeck_friction", tau_c=0.15, tau_s=0.15, omega_s=0.1)
    assert advised(rubbing("coulomb_friction", tau_c=0.15), alike).startswith("No motion")


def test_no_motion_is_advised_where_the_noise_hides_nothing() -> None:
    """Two frictions of different sizes, far beyond the noise: "differ by 1.8e+05 times the noise" helped nobody."""
    text = advised(rubbing("coulomb_friction", tau_c=0.15), rubbing("viscous_friction", b_v=0.4))
    assert text.startswith("In these recordings Coulomb friction and viscous friction differ by more than the noise")


def test_nothing_to_tell_apart() -> None:
    """One model needs no advice."""
    assert advised(rubbing("coulomb_friction", tau_c=0.15)) == ""


def test_no_advice_when_the_time_is_up() -> None:
    """A motion with stiff friction takes a minute to be compared: a search whose time is up ends without it."""
    with within(0.0):
        assert advised(rubbing("coulomb_friction", tau_c=0.15), rubbing("viscous_friction", b_v=0.1)) == ""


def test_a_friction_that_the_fit_found_stiff_is_stepped_finely_enough() -> None:
    """The step of the task is that of the file's model: with it 1500/s grew to 1e257, numpy warned, and the advice told
    of a difference of "nan"."""
    times = np.arange(2000) / 500
    torque = 40 * np.sin(12 * times)
    rough = build_model("joint", ["viscous_friction"], {"J": 2e-2, "viscous_friction.b_v": 1e-3})
    position = rough.simulate(Sampled(times, torque), times)["position"]
    recording = Recording(times, {"torque": torque, "position": position}, name="rec.csv")
    stiff = [
        build_model("joint", [effect], {"J": 2e-5, f"{effect}.{name}": value})
        for effect, name, value in [("viscous_friction", "b_v", 0.03), ("quadratic_damping", "b2", 1e-5)]
    ]
    own = replace(Task.of(rough, experiments(rough, [recording]), {"position": 1.0}), substep_s=0.004)
    with warnings.catch_warnings(), ThreadPoolExecutor(2) as pool:
        warnings.simplefilter("error")
        text = what_to_record(stiff, own, pool)
    assert text
    assert "nan" not in text
