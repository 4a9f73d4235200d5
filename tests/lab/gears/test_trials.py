"""Which beginnings survive: a number of teeth that is a little off, what the score test alone leads to."""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from lostmotion.lab import policy
from lostmotion.lab.data.experiment import experiments
from lostmotion.lab.data.noise import noise_of
from lostmotion.lab.deadline import within
from lostmotion.lab.fitting.strategy import full_fit, settled
from lostmotion.lab.gears.score_test import score_test
from lostmotion.lab.gears.trials import (
    FEW_STEPS,
    Trial,
    _best_of_each,
    full_fits,
    halving,
    near_trials,
    observer_trials,
    with_other_delays,
)
from lostmotion.lab.observer.global_search import Optimum
from lostmotion.lab.selection.nesting import others
from lostmotion.lab.shooting.task import Task
from lostmotion.model import build_model
from tests.lab.simulated_gears import GEARS, gears

TRUE = {"gear_eccentricity.e": 1e-5, "gear_eccentricity.N": 20.0, "gear_eccentricity.phi": 1.1}


@pytest.mark.slow
def test_teeth_are_counted_on_short_segments() -> None:
    """From three teeth off, where long segments would lose the motion, successive halving comes to the true number and
    size."""
    model = build_model("play", values=GEARS)
    held = experiments(model, [gears(seed, **TRUE) for seed in (71, 72)])
    task = Task.of(model, held, noise_of(held))
    near = model.with_effect("gear_eccentricity").replace(TRUE | {"gear_eccentricity.N": 23.0})
    with ThreadPoolExecutor(2) as pool:
        (trial,) = halving(full_fits([("gear_eccentricity", near)], task, pool), task, 0.5, pool)
    found = trial.level.model.parameters
    assert found["gear_eccentricity.N"].value == 20
    assert found["gear_eccentricity.e"].value == pytest.approx(1e-5, rel=0.03)
    assert trial.level.typical == pytest.approx(1.0, abs=0.05)


@pytest.mark.slow
@pytest.mark.parametrize(("seeds", "truth", "begun"), [
    ((71, 72), {"gear_eccentricity.e": 4e-6, "gear_eccentricity.N": 39.0, "gear_eccentricity.phi": -1.2},
     {"gear_eccentricity.N": 31.0}),
    ((81, 82), {"shaft_compliance.share": 0.6, "shaft_compliance.k_s": 70.0, "shaft_compliance.c_s": 0.015},
     {"shaft_compliance.share": 0.8, "shaft_compliance.k_s": 150.0, "shaft_compliance.c_s": 0.0}),
])  # fmt: skip
def test_a_fit_begins_again_where_it_may_have_another_minimum(
    seeds: tuple[int, ...], truth: dict[str, float], begun: dict[str, float]
) -> None:
    """Eight teeth off, with initial states of the wrong number, the count ended at 27 teeth and 3.6 times the noise; a
    shaft without damping ended at 100 N m/rad for 70."""
    model, effect = build_model("play", values=GEARS), next(iter(truth)).split(".")[0]
    held = experiments(model, [gears(seed, **truth) for seed in seeds])
    task = Task.of(model, held, noise_of(held))
    off = model.with_effect(effect).replace(truth | begun)
    with ThreadPoolExecutor(2) as pool:
        (trial,) = halving(full_fits([(effect, off)], task, pool), task, 0.5, pool)
    for name in begun:
        assert trial.level.model.parameters[name].value == pytest.approx(truth[name], rel=0.05)


def test_of_several_fits_of_an_effect_the_best_one_leads() -> None:
    """Two fits of one effect, the worse one behind that of another effect."""
    fits = [("a", 3.0), ("b", 2.0), ("a", 1.0), ("c", math.inf)]
    trials: Any = [Trial(effect, SimpleNamespace(typical=typical)) for effect, typical in fits]  # type: ignore[arg-type]
    assert [(one.effect, one.level.typical) for one in _best_of_each(trials)] == [("a", 1.0), ("b", 2.0)]


def test_a_delay_of_zero_is_exchanged_for_none() -> None:
    """A fit may end at a delay of zero, which the lag of an actuator or a sensor cannot have; any other delay may be
    either."""
    model = build_model("play", values=GEARS)
    held = experiments(model, [gears(71)])
    task = Task.of(model, held, noise_of(held))
    delayed = model.with_effect("command_delay")
    assert list(with_other_delays(delayed.replace({"command_delay.T": 0.0}), task)) == []
    others = dict(with_other_delays(delayed.replace({"command_delay.T": 2e-3}), task))
    assert others["actuator_lag"].parameters["actuator_lag.T"].value == 2e-3


@pytest.mark.slow
def test_the_effect_that_delays_a_signal_is_proposed_with_another_one() -> None:
    """Only a delay of the command was proposed; the lag of the sensor, which is to first order the same, follows."""
    model = build_model("play", values=GEARS)
    held = experiments(model, [gears(seed, 1.2, **{"sensor_lag.T": 3e-3}) for seed in (71, 72)])
    task = Task.of(model, held, noise_of(held))
    delayed = model.with_effect("command_delay").replace({"command_delay.T": 2.5e-3})
    with ThreadPoolExecutor(2) as pool:
        found = halving(full_fits([("command_delay", delayed)], task, pool), task, 0.1, pool)
    assert found[0].effect == "sensor_lag"
    assert found[0].level.model.parameters["sensor_lag.T"].value == pytest.approx(3e-3, rel=0.03)
    assert found[0].level.typical == pytest.approx(1.0, abs=0.15)


@pytest.mark.slow
def test_initial_states_are_searched_for_until_the_error_stays() -> None:
    """An actuator with a wrong inertia and damping: most segments are missed at first, and none at the end."""
    truth = {"finite_actuator.J1": 1.1e-3, "finite_actuator.f1": 16.0, "finite_actuator.zeta1": 0.76}
    model = build_model("play", values=GEARS)
    held = experiments(model, [gears(seed, **truth) for seed in (81, 82)])
    task = Task.of(model, held, noise_of(held))
    wrong = model.with_effect("finite_actuator").replace(
        truth | {"finite_actuator.J1": 3e-4, "finite_actuator.zeta1": 3.0}
    )
    begun = full_fit(wrong, task, 0.4)
    found = settled(begun, task)
    assert begun.typical > 2.0
    assert found.typical == pytest.approx(1.0, abs=0.1)
    assert found.model.parameters["finite_actuator.J1"].value == pytest.approx(1.1e-3, rel=0.05)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("hidden", "size", "length", "asked"),
    [("hardening_spring.k3", 1e10, 2.0, False), ("viscous_friction.b_v", 5e-4, 1.2, True)],
)
def test_observer_runs_are_asked_where_more_than_noise_is_left(
    hidden: str, size: float, length: float, asked: bool
) -> None:
    """A spring that hardens moves no impact: the score test alone leads to it.  Friction moves them all."""
    model = build_model("play", values=GEARS)
    held = experiments(model, [gears(seed, length, **{hidden: size}) for seed in (75, 76)])
    task = Task.of(model, held, noise_of(held))
    base = full_fit(model, task)
    with ThreadPoolExecutor(2) as pool:
        scores = score_test(base, others(model), task.substep_s, pool, np.random.default_rng(0))
        near = near_trials(base, scores.directions[: policy.FINISHED], task, pool, FEW_STEPS)
        trials = full_fits([(trial.effect, trial.level.model) for trial in near], task, pool)
    assert base.typical > 2
    if asked:
        assert not trials or trials[0].level.typical > policy.FAR
    else:
        assert trials[0].effect == hidden.split(".")[0]
        assert trials[0].level.typical < policy.FAR


def test_what_observers_propose_is_fitted_in_two_batches(monkeypatch: pytest.MonkeyPatch) -> None:
    """The better half first; a law that contains one of the model in the place of that."""
    base = build_model("play", ["coulomb_friction"], GEARS)
    names = ["stribeck_friction", "gear_eccentricity", "gear_eccentricity", "clock_skew", "command_delay"]
    found = [Optimum(base.with_effect(name), 1.0 + at, name) for at, name in enumerate(names)]
    fitted = list[list[tuple[str, Any]]]()
    monkeypatch.setattr("lostmotion.lab.gears.trials.full_fits", lambda begin, *rest: fitted.append(begin) or begin)
    task, pool = cast(Any, None), cast(Any, None)
    batches = observer_trials(found, task, pool)
    assert [effect for effect, _ in cast(Any, next(batches))] == names[:3]
    assert fitted[0][0][1].effects == ("stribeck_friction",)
    assert [effect for effect, _ in cast(Any, next(batches))] == names[3:]
    assert not list(batches)
    with within(0.0):
        assert len(list(observer_trials(found, task, pool))) == 1
    assert not list(observer_trials([], task, pool))
