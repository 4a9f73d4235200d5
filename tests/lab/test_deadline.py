"""The time of a search: it goes along into threads and processes, and fits end with it."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence

import numpy as np
import pytest

from lostmotion.drivers.recording import Recording
from lostmotion.lab import experiments, explain, open_executor
from lostmotion.lab.deadline import is_over, remaining_s, within
from lostmotion.lab.inverse import free_parameters, likelihood, regression
from lostmotion.lab.inverse.output_error import OutputError
from lostmotion.lab.inverse.problem import Point
from lostmotion.lab.inverse.regression import Regression
from lostmotion.lab.inverse.signals import Signals
from lostmotion.lab.shooting.parameters import Unknowns
from lostmotion.model import HandWaved, Model, build_model
from tests.lab.simulated_gears import GEARS, gears


def test_a_block_inside_of_another_has_a_time_of_its_own() -> None:
    """Outside of any block time never ends; after a block the one around it counts again."""
    assert not is_over()
    with within(1000.0):
        with within(-1.0):
            assert is_over()
        assert 990.0 < remaining_s() <= 1000.0
    assert remaining_s() == np.inf


@pytest.mark.parametrize("spec", ["threads:2", pytest.param("processes:1", marks=pytest.mark.slow)])
def test_workers_know_the_time_of_who_asks(spec: str) -> None:
    """A thread or process that works for a search is over when the search is, and only then."""
    with open_executor(spec) as pool:
        with within(-1.0):
            assert pool.submit(is_over).result()
        assert not pool.submit(is_over).result()


def servo(seed: int) -> Recording:
    """A servo with dry friction, by the model."""
    times = np.arange(0.0, 4.0, 0.01)
    model = build_model("servo", ["viscous_friction", "coulomb_friction"])
    run = model.simulate(HandWaved(seed=seed), times)
    angle = run["position"] + 5e-4 * np.random.default_rng(seed).standard_normal(times.size)
    return Recording(times, {"command": run["command"], "position": angle}, {}, {}, 0, f"servo{seed}.csv")


def test_a_fit_ends_with_what_it_knows_when_the_time_is_up(monkeypatch: pytest.MonkeyPatch) -> None:
    """After the end of the time no derivative is begun: simulations go on for the rest of the last step only, whatever
    they cost.  Derivatives at the end took servos on busy cores half a minute more than they had."""
    model = build_model("servo", ["viscous_friction", "coulomb_friction"])
    signals = [Signals.of(one, is_force=False) for one in experiments(model, [servo(1), servo(2)])]
    data, asked = OutputError.of(signals, model), list[tuple[bool, int]]()
    count = len(Unknowns.of(model).items) + data.nuisance.size // 2

    def counted(self: OutputError, points: Sequence[Point]) -> object:
        asked.append((free_parameters.is_over(), len(points)))
        return residuals(self, points)

    residuals = OutputError.residuals
    monkeypatch.setattr(OutputError, "residuals", counted)
    monkeypatch.setattr(free_parameters, "is_over", lambda: sum(number for _, number in asked) > count + 3)
    found = regression.regressed(model, data)
    assert np.isfinite(found.rms)
    assert found.jacobian.shape == (found.residual.size, found.count + found.nuisance.size)
    assert free_parameters.is_over()
    assert [is_late for is_late, number in asked if number > 1] == [False]


def test_an_answer_comes_without_any_time() -> None:
    """With a budget of nothing the model is fitted as far as that goes, and what was not tried is named."""
    model = build_model("servo", ["viscous_friction"])
    with open_executor("threads:1") as pool:
        found = explain(model, experiments(model, [servo(1), servo(2)]), pool, budget_s=0.0)
    assert "coulomb_friction" in found.untried
    assert found.missing == ()
    assert np.isfinite(found.error.before)


def test_the_used_parts_of_long_recordings_do_not_depend_on_how_fast_they_were_read() -> None:
    """Of gears those parts are used that the whole budget suffices for: the same command gives the same answer on a
    busy machine."""
    model = build_model("play", values=GEARS)
    recorded = experiments(model, [gears(1), gears(2)])
    with open_executor("threads:1") as pool:
        at_once, late = (explain(model, recorded, pool, budget_s=2.0, spent_s=spent_s) for spent_s in (1.9, 1.99))
    used_s, whole_s = at_once.used_s
    assert used_s < whole_s
    assert late.used_s == at_once.used_s


def test_one_slow_effect_does_not_take_the_time_of_the_others(monkeypatch: pytest.MonkeyPatch) -> None:
    """A fit that does not end is given its share; all other effects are fitted."""
    tried = list[str]()

    def slow(
        wide: tuple[str, Model], now: Regression, begun: Mapping[str, Regression], rough: Model
    ) -> Regression | None:
        tried.append(wide[0])
        while wide[0] == "coulomb_friction" and not is_over():
            time.sleep(0.01)
        return None

    monkeypatch.setattr(likelihood, "fitted_with", slow)
    monkeypatch.setattr(likelihood.WholeMotion, "_by_equation_error", lambda self, wide, now: ({}, {}))
    model = build_model("servo", ["viscous_friction"])
    signals = [Signals.of(one, is_force=False) for one in experiments(model, [servo(1), servo(2)])]
    asked = likelihood.WholeMotion(likelihood.Method.MOTION, model, signals)
    now = asked.first
    with within(4.0):
        (found,) = asked.proposals(now, ())
    assert tried.index("coulomb_friction") < len(tried) - 1
    assert found.untried == ()
