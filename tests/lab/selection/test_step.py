"""Effects beyond the first few, and the first of two taken on trust, on recordings of the bench's own simulator."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

from lostmotion.lab.data.experiment import experiments
from lostmotion.lab.fitting.fit import noise_of
from lostmotion.lab.fitting.strategy import doubled, full_fit
from lostmotion.lab.observer.global_search import Near, cost_of
from lostmotion.lab.selection.score_test import score_test
from lostmotion.lab.selection.step import Step, Tried, further, promising
from lostmotion.lab.selection.validate import Unseen
from lostmotion.lab.shooting.continuation import Level
from lostmotion.lab.shooting.task import Task
from lostmotion.model import build_model
from tests.lab.gears import GEARS, gears

HIDDEN = {"coulomb_friction.tau_c": 4e-4, "contact_asymmetry.ratio": 4.0}


@pytest.mark.slow
def test_what_brings_observer_runs_far_nearer_than_all_others_is_trusted() -> None:
    """Of two hidden effects one is put first although it explains too little alone; not where the next one comes as
    near, nor where the base does."""
    model = build_model("play", values=GEARS)
    held = experiments(model, [gears(seed, **HIDDEN) for seed in (81, 82, 83)])
    task = Task.of(model, held[:2], noise_of(held))
    short = full_fit(model, task)
    usual = cost_of(short, task)
    right = model.with_effect("coulomb_friction").replace({"coulomb_friction.tau_c": 4e-4})
    other = model.with_effect("viscous_friction")
    with ThreadPoolExecutor(2) as pool:
        unseen = Unseen(held[2], task, 0.5, pool)
        now = unseen.judge(short.model)
        scores = score_test(short, ["viscous_friction"], task.substep_s, pool, np.random.default_rng(0))

        def trusted(nearest: float, next_one: float) -> Step | None:
            near = (Near(right, nearest, "coulomb_friction"), Near(other, next_one, "viscous_friction"))
            return promising(Step(scores, near=near), short, now, unseen)

        step = trusted(0.5 * usual, 0.9 * usual)
        assert trusted(0.5 * usual, 0.52 * usual) is None
        assert trusted(0.95 * usual, 2 * usual) is None
        assert promising(Step(scores), short, replace(now, error=1.0), unseen) is None

        def alone(level: Level) -> Step | None:
            return promising(Step(scores, (Tried("viscous_friction", level, now),)), short, now, unseen)

        longer = doubled(short, task)
        assert longer is not None
        survivors = alone(longer)
        assert alone(short) is None
    assert survivors is not None, "all others were dropped"
    assert step is not None
    assert step.trusted
    assert step.accepted
    assert step.tried[0].effect == "coulomb_friction"
    assert step.tried[0].level.typical < short.typical
    assert step.tried[0].judged.error < now.error


@pytest.mark.slow
def test_an_effect_that_comes_fifth_is_found_where_four_others_were_not_it() -> None:
    """What observer runs come near to is only a hint: the next few are fitted before the search gives up."""
    model = build_model("play", values=GEARS)
    held = experiments(model, [gears(seed, **{"coulomb_friction.tau_c": 4e-4}) for seed in (84, 85, 86)])
    task = Task.of(model, held[:2], noise_of(held))
    short = full_fit(model, task)
    right = model.with_effect("coulomb_friction").replace({"coulomb_friction.tau_c": 3e-4})
    first = [Near(model.with_effect(name), 0.5, name) for name in ("bias_drift", "second_mode", "gravity_leakage")]
    first.append(Near(model.with_effect("sensor_lag"), 0.55, "sensor_lag"))
    with ThreadPoolExecutor(2) as pool:
        unseen = Unseen(held[2], task, 0.5, pool)
        now = unseen.judge(short.model)
        scores = score_test(short, ["bias_drift"], task.substep_s, pool, np.random.default_rng(0))

        def found(*near: Near) -> Step:
            return further(Step(scores, near=(*first, *near)), short, now, unseen)

        fifth = found(Near(right, 0.6, "coulomb_friction"))
        assert not found(Near(model.with_effect("clock_skew"), 0.6, "clock_skew")).accepted
        assert not found(Near(right, 0.95, "coulomb_friction")).accepted, "too far behind"
        assert not found().accepted
    assert fifth.accepted
    assert fifth.tried[0].effect == "coulomb_friction"
    assert fifth.tried[0].judged.error == pytest.approx(1.0, abs=0.1)
