"""A delay and a lag distinguished, by the bench's simulator; starts that another model knows."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

from lostmotion.lab.data.experiment import experiments
from lostmotion.lab.data.stationarity import is_structured
from lostmotion.lab.fitting.fit import noise_of
from lostmotion.lab.fitting.strategy import full_fit
from lostmotion.lab.selection.alternatives import distinguished
from lostmotion.lab.selection.score_test import Scores
from lostmotion.lab.selection.step import Step, Tried
from lostmotion.lab.selection.validate import Unseen, is_left
from lostmotion.lab.shooting.continuation import residuals
from lostmotion.lab.shooting.task import Task
from lostmotion.model import build_model
from tests.lab.gears import GEARS, gears


@pytest.mark.slow
@pytest.mark.parametrize(("hidden", "met"), [("actuator_lag", "command_delay"), ("command_delay", "actuator_lag"),
                                             ("command_delay", "command_delay")])  # fmt: skip
def test_which_one_it_is(hidden: str, met: str) -> None:
    """Whichever the search has met first, the one that is there is named, with its time."""
    model = build_model("play", values=GEARS)
    *train, last = held = experiments(model, [gears(seed, **{f"{hidden}.T": 3e-3}) for seed in (61, 62, 63)])
    task = Task.of(model, train, noise_of(held))
    with ThreadPoolExecutor(2) as pool:
        unseen = Unseen(last, task, 0.5, pool)
        level = full_fit(model.with_effect(met).replace({f"{met}.T": 2.5e-3}), task)
        before, first = unseen.judge(full_fit(model, task).model), Tried(met, level, unseen.judge(level.model), 0.5)
        other = Tried("bias_drift", level, first.judged, 0.6)
        step = Step(Scores(), (first, other), accepted=True)
        alternatives = distinguished(step, before, unseen)
    assert [one.effect for one in alternatives.tried] == list(dict.fromkeys([hidden, met, "bias_drift"]))
    found = alternatives.tried[0].level.model
    assert found.effects == (hidden,)
    assert found.parameters[f"{hidden}.T"].value == pytest.approx(3e-3, rel=0.03 if hidden != met else 0.1)


@pytest.mark.slow
def test_what_is_left_is_told_by_the_segments_that_are_followed_best() -> None:
    """With its Coulomb friction nothing is left of gears, although a segment of unseen data begins a little off."""
    model = build_model("play", values=GEARS)
    *train, last = held = experiments(model, [gears(seed, **{"coulomb_friction.tau_c": 5e-4}) for seed in (65, 66, 67)])
    task = Task.of(model, train, noise_of(held))
    with ThreadPoolExecutor(2) as pool:
        unseen = Unseen(last, task, 0.5, pool)
        level = full_fit(model.with_effect("coulomb_friction").replace({"coulomb_friction.tau_c": 5e-4}), task)
        judged = unseen.judge(level.model)
    assert is_structured([judged.parts[i] for i in judged.kept])
    assert not is_left(judged)


def test_a_lost_segment_begins_where_another_model_follows_it() -> None:
    """Of two models that are the same, one is made to begin far off in a segment: it borrows the other one's start."""
    model = build_model("play", values=GEARS)
    (experiment,) = experiments(model, [gears(64, 1.0)])
    task = Task.of(model, [experiment], {"accel": 0.2})
    with ThreadPoolExecutor(2) as pool:
        unseen = Unseen(experiment, task, 0.25, pool)
        good = unseen.judge(model)
        segments = list(good.segments)
        off = segments[1].start + np.array([0.004, 3.0, 0.0, 0.0])
        segments[1] = segments[1].starting(off)
        poor = replace(good, segments=tuple(segments), parts=tuple(residuals(model, segments, task.substep_s)))
        again = unseen.again(model, poor, good)
    assert poor.errors[1] > 3 * good.errors[1]
    np.testing.assert_allclose(again.errors, good.errors, rtol=1e-3)
    assert good.error == pytest.approx(1.0, abs=0.15)
