"""Runs corrected by a measurement, on recordings of the bench's own simulator: what they follow, play and effect
found."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from lostmotion.lab import policy
from lostmotion.lab.data.experiment import Experiment, experiments
from lostmotion.lab.fitting.strategy import full_fit, with_bar_frequency
from lostmotion.lab.observer.filter import STRONG, WEAK, Observer, can_follow, states_at
from lostmotion.lab.observer.global_search import search_effects, search_parameters
from lostmotion.lab.observer.objective import Follower
from lostmotion.lab.shooting.task import Task
from lostmotion.model import Model, build_model
from lostmotion.model.lanes import LANES
from lostmotion.model.motion import FloatArray
from lostmotion.model.observer import follow
from tests.lab.simulated_gears import GEARS, LENGTH, NOISE, RATE_HZ, gears, moved

SUBSTEP = 2.5e-4


def recorded(
    seed: int, hidden: dict[str, float] | None = None, length: float = LENGTH
) -> tuple[Experiment, FloatArray]:
    """Some seconds of gears that were in motion before, and the states (N, 4)."""
    run = moved(seed, length, **(hidden or {}))
    (experiment,) = experiments(build_model("play"), [run.recording(run.accel + NOISE * run.noise, f"run {seed}")])
    return experiment, run.states[:, :4]


def rough(d: float) -> Model:
    """The gears as a user knows them."""
    return build_model("play", values={"d": d, "k": 2600.0 * 0.95, "alpha": 3000.0, "b": 0.25})


def alone(held: list[Experiment], model: Model) -> list[Task]:
    """Each experiment as a task of its own."""
    task = Task.of(model, held, {"accel": NOISE})
    return [replace(task, experiments=(one,)) for one in held]


def test_without_a_gain_it_is_a_simulation() -> None:
    """Nothing is corrected: errors are those of the model's own run from the same state."""
    experiment, _ = recorded(1)
    model = build_model("play", values=GEARS)
    start = model.initial_state(experiment.drive, float(experiment.time[0]))
    run = model.observer(experiment.drive, experiment.time, "accel", experiment.clock_zero)
    (e,), (states,), _ = follow([run], start[None], np.zeros((1, 4)), experiment.measured["accel"], 1e-4)
    free = model.simulate(experiment.drive, experiment.time, start, substep_s=1e-4)
    early = slice(0, 200)  # later, chaos makes much of a knot more or less
    assert e[early] == pytest.approx(experiment.measured["accel"][early] - free["accel"][early], abs=1e-5)
    assert states[early] == pytest.approx(free.states[early], abs=1e-7)


def test_a_run_finds_into_the_motion() -> None:
    """From a state that is only a guess it comes to the true one: the place in the gap, the speed, the bar."""
    experiment, true = recorded(2)
    model = build_model("play", values=GEARS)
    times = experiment.time[[40, 400, 800, 1200, 1500]]
    found = states_at(model, experiment, times, SUBSTEP)
    assert sorted(found) == pytest.approx(times[1:])  # the first is too early to know
    for time, states in found.items():
        off = states[1] - true[np.searchsorted(experiment.time, time - 1e-9)]
        assert abs(off[0]) < 0.25 * GEARS["d"] / 2 / 0.01
        assert abs(off[1]) < 0.05
        assert abs(off[2]) < 2e-5


def test_errors_are_as_large_as_expected() -> None:
    """A true model misses the next sample by little more than the noise, one with half the play by far more."""
    experiment, _ = recorded(3)
    observer = Observer.of(build_model("play", values=GEARS), 1 / RATE_HZ, WEAK)
    assert 1.0 < observer.expected < Observer.of(build_model("play", values=GEARS), 1 / RATE_HZ, STRONG).expected < 2.0

    def typical(d: float) -> float:
        e, _ = observer.run(build_model("play", values={**GEARS, "d": d}), experiment, SUBSTEP)
        return float(np.median(np.abs(e[200:]))) * 1.4826 / NOISE / observer.expected

    assert typical(8e-5) < 2.0
    assert typical(4e-5) > 2 * typical(8e-5)


@pytest.mark.parametrize("coupling", [STRONG, WEAK])
def test_a_cost_beyond_what_matters_is_known_sooner(coupling: float) -> None:
    """A cost up to the limit is the same to the last digit; above it the run ends, and what is told is above it, also
    beside a run that does not end."""
    model = build_model("play", values=GEARS)
    task = Task.of(model, [recorded(seed)[0] for seed in (3, 4)], {"accel": NOISE})
    follower, poor = Follower.of(task, model), model.replace({"d": 4e-5})
    exact = follower.costs([poor, model], coupling)
    assert exact[0] > 1.2 * exact[1]
    assert np.array_equal(follower.costs([poor, model], coupling, exact), exact)
    poor_ends = follower.costs([poor, model], coupling, np.array([0.9, 1.0]) * exact)
    assert poor_ends[0] > 0.9 * exact[0]
    assert poor_ends[1] == exact[1]


@pytest.mark.parametrize(
    "effects", [[], ["shaft_compliance", "coulomb_friction"], ["gear_eccentricity"], ["sensor_lag"]]
)
def test_observers_side_by_side_are_observers_alone(effects: list[str]) -> None:
    """More of them than lanes, with other values each; one of them diverges, and one has another delay."""
    held = [recorded(seed)[0] for seed in (3, 4)]
    model = build_model("play", [*effects, "command_delay"], GEARS)
    follower = Follower.of(Task.of(model, held, {"accel": NOISE}), model)
    models = [model.replace({"d": 8e-5 * (1 + 0.01 * k), "alpha": 4000.0 - 50 * k}) for k in range(LANES + 2)]
    models += [model.replace({"command_delay.T": 2e-3}), model.replace({"alpha": 1e9})]
    e = follower.errors(models, STRONG)
    for number, one in enumerate(models):
        (alone,) = follower.errors([one], STRONG)
        assert np.array_equal(np.isfinite(alone), np.isfinite(e[number]))
        seen = np.isfinite(alone)
        assert e[number][seen] == pytest.approx(alone[seen], abs=1e-6)
    costs = follower.costs(models, WEAK)
    assert costs == pytest.approx([follower.cost(one, WEAK) for one in models], rel=1e-9)
    assert np.ptp(costs[: LANES + 2]) > 1e-3


@pytest.mark.slow
def test_behind_a_shaft_the_right_model_follows() -> None:
    """Where a shaft twists between teeth and bar, a model that has it misses far less than one that has not."""
    hidden = {"shaft_compliance.share": 0.7, "shaft_compliance.k_s": 30.0, "shaft_compliance.c_s": 5e-3}
    stiff = build_model("play", values=GEARS)
    soft = stiff.with_effect("shaft_compliance").replace(hidden)

    held = [recorded(seed, hidden)[0] for seed in (21, 22, 24, 25)]
    followers = [Follower.of(task, stiff) for task in alone(held, stiff)]
    assert sum(f.cost(soft, STRONG) for f in followers) < 0.5 * sum(f.cost(stiff, STRONG) for f in followers)


@pytest.mark.slow
def test_the_joint_goes_to_where_the_teeth_struck(monkeypatch: pytest.MonkeyPatch) -> None:
    """With the way that the teeth were still to go corrected as well as the speed, the right model misses less."""
    model = build_model("play", values=GEARS)
    followers = [Follower.of(task, model) for task in alone([recorded(seed)[0] for seed in range(31, 37)], model)]
    with_way = sum(follower.cost(model, STRONG) for follower in followers)
    monkeypatch.setattr("lostmotion.lab.observer.filter.EARLIER_S", 0.0)
    assert with_way < 0.9 * sum(follower.cost(model, STRONG) for follower in followers)


def test_between_samples_of_the_bar() -> None:
    """A servo's rows hold no acceleration: runs pass over them, and tell the state there as well as elsewhere."""
    experiment, true = recorded(2)
    assert can_follow(build_model("play"), experiment)
    assert not can_follow(build_model("joint"), experiment)
    model, rows = build_model("play", values=GEARS), np.array([400, 800, 1200, 1500])
    with_gaps = experiment.measured["accel"].copy()
    with_gaps[rows] = np.nan
    servo = replace(experiment, measured={"accel": with_gaps})
    found = states_at(model, servo, experiment.time[rows], SUBSTEP)
    assert len(found) == rows.size
    for row, states in zip(rows, found.values(), strict=True):
        assert abs(states[1][0] - true[row][0]) < 0.25 * GEARS["d"] / 2 / 0.01
        assert abs(states[1][1] - true[row][1]) < 0.05


@pytest.mark.slow
@pytest.mark.parametrize("d", [5.7e-5, 10.3e-5])
def test_the_play_is_found_from_afar(d: float) -> None:
    """A play that is off by 28 % either way, and a damping by a third, come out within 3 and 20 %."""
    task = Task.of(rough(d), [recorded(5)[0], recorded(6)[0]], {"accel": NOISE})
    found = search_parameters(with_bar_frequency(rough(d), task.experiments), task).parameters
    assert found["d"].value == pytest.approx(8e-5, rel=0.03)
    assert found["alpha"].value == pytest.approx(4000.0, rel=0.2)


@pytest.mark.slow
def test_the_hidden_effect_is_first_of_the_shortlist() -> None:
    """A viscous friction that moves every impact is named before dry friction and a delay, and its size is found."""
    hidden = {"viscous_friction.b_v": 6e-4}
    task = Task.of(rough(7e-5), [recorded(seed, hidden, 1.5)[0] for seed in (7, 8)], {"accel": NOISE})
    base = full_fit(search_parameters(with_bar_frequency(task.rough, task.experiments), task), task)
    with ThreadPoolExecutor(2) as pool:
        found = search_effects(base, ["coulomb_friction", "command_delay", "viscous_friction"], task, pool)
    assert found[0].effect == "viscous_friction"
    assert found[0].cost < 0.8 * found[1].cost
    assert found[0].model.parameters["viscous_friction.b_v"].value == pytest.approx(6e-4, rel=0.1)


@pytest.mark.slow
def test_few_are_followed_to_the_end() -> None:
    """Of ten effects five, the one that is there first."""
    task = Task.of(rough(8e-5), [recorded(11, length=1.0)[0]], {"accel": NOISE})
    base = full_fit(search_parameters(with_bar_frequency(task.rough, task.experiments), task), task)
    effects = ["bias_drift", "clock_skew", "second_mode", "sensor_saturation", "gravity_leakage", "sensor_lag",
               "centripetal_crosstalk", "quadratic_damping", "load_dependent_friction", "gravity_torque"]  # fmt: skip
    half = task.experiments[0].measured["accel"].max() / 2
    clipped = Task.of(rough(8e-5), experiments(build_model("play"), [gears(11, 1.0, largest=half)]), {"accel": NOISE})
    with ThreadPoolExecutor(2) as pool:
        found = search_effects(base, effects, clipped, pool)
    assert found[0].effect == "sensor_saturation"
    assert len({near.effect for near in found}) == policy.FINISHED


@pytest.mark.parametrize("effect", ["clock_skew", "command_delay"])
def test_a_population_keeps_a_fitted_shift_of_time(effect: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """All members have the fitted value of the model's delay or clock, so that they are computed side by side; that of
    the effect that is looked for varies."""
    (name,) = (n for n in rough(8e-5).with_effect(effect).parameters if n.startswith(f"{effect}."))
    task = Task.of(rough(8e-5), [recorded(11, length=0.5)[0]], {"accel": NOISE})
    met = list[float]()
    costs = Follower.costs

    def noted(self: Follower, models: Sequence[Model], *rest: Any) -> FloatArray:
        met.extend(model.parameters[name].value for model in models)
        return costs(self, models, *rest)

    monkeypatch.setattr(Follower, "costs", noted)
    base = full_fit(task.rough, task)
    with ThreadPoolExecutor(1) as pool:
        search_effects(base, [effect], task, pool)
        assert len(set(met)) > 100
        met.clear()
        other = replace(base, model=base.model.with_effect(effect).replace({name: 1e-3}))
        search_effects(other, ["viscous_friction"], task, pool)
    assert set(met[: policy.FINISHED * LANES]) == {1e-3}
