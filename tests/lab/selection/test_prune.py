"""Effects that were added needlessly are taken out again; how misfits of models are compared."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

from lostmotion.lab.data.experiment import experiments
from lostmotion.lab.fitting.fit import noise_of
from lostmotion.lab.fitting.strategy import doubled, full_fit
from lostmotion.lab.selection.candidates import others
from lostmotion.lab.selection.nesting import without
from lostmotion.lab.selection.prune import simplified
from lostmotion.lab.selection.validate import Judged, Unseen, better, misfits
from lostmotion.lab.shooting.task import Task
from lostmotion.model import build_model
from tests.lab.gears import GEARS, gears


def judged(*errors: float) -> Judged:
    """On segments of 100 samples."""
    return Judged(tuple(np.full(100, error) for error in errors))


def test_a_lost_segment_counts_but_not_without_end() -> None:
    """One model loses two of five segments: it is worse by what they count at most, whatever chaos makes of them."""
    good, poor, poorer = judged(1, 1, 1, 1, 1), judged(1, 1, 1, 5, 9), judged(1, 1, 1, 500, 1e9)
    assert misfits([good, poor]) == pytest.approx([0.0, 2 / 5 * np.log(3)])
    assert misfits([good, poorer]) == pytest.approx(misfits([good, poor]))
    assert better(good, poor)
    assert not better(poor, good)


def test_what_helps_by_less_than_chance_is_not_better() -> None:
    """A gain of half a percent is none, one of two percent is one."""
    assert not better(judged(0.995, 0.995), judged(1, 1))
    assert better(judged(*[0.98] * 40), judged(*[1.0] * 40))


def test_far_from_what_is_added_to_the_readings_an_effect_has_to_explain_a_good_part() -> None:
    """An error of a third less is enough near the noise and near a hum, which the shortest segments leave, too; far
    from both it is not, as impacts that moved explain as much."""
    now, after = judged(*[3.0] * 4), judged(*[2.0] * 4)
    assert better(after, now)
    assert not better(after, now, is_far=True)
    assert better(judged(*[1.7] * 4), now, is_far=True)
    model = build_model("play", values=GEARS)
    held = experiments(model, [gears(1)])
    with ThreadPoolExecutor(1) as pool:
        unseen = Unseen(held[0], Task.of(model, held, {"accel": 0.2}), 0.25, pool)
        assert not unseen.is_better(after, now)
        assert replace(unseen, floor=1.5).is_better(after, now)


@pytest.mark.slow
def test_what_is_near_is_told_by_the_shortest_segments() -> None:
    """A fit on longer segments leaves what is missing there, too: beside it an error counts as near by what the same
    model leaves of the shortest ones."""
    model = build_model("play", values=GEARS)
    held = experiments(model, [gears(seed, 2.0, **{"viscous_friction.b_v": 6e-4}) for seed in (7, 8)])
    task = Task.of(model, held, noise_of(held))
    short = full_fit(model, task)
    longer = doubled(short, task)
    assert longer is not None
    with ThreadPoolExecutor(2) as pool:
        unseen = Unseen(held[1], task, 0.5, pool)
        floor = unseen.with_floor_of(longer).floor
    assert longer.typical > 1.5 * short.typical
    assert floor == pytest.approx(short.typical, rel=0.4)


def test_what_contains_another_goes_on_with_what_that_did() -> None:
    """Coulomb's friction beside Stribeck's, taken out: the same motion, by Stribeck's alone; nor is it tried again."""
    both = build_model("joint", ["coulomb_friction", "stribeck_friction"])
    alone = without(both, "coulomb_friction")
    times = np.linspace(0, 1, 200)
    before, after = (model.simulate(None, times, [0.0, 3.0]).signals["velocity"] for model in (both, alone))
    assert alone.effects == ("stribeck_friction",)
    assert after == pytest.approx(before, rel=1e-6)
    assert "coulomb_friction" not in others(alone)
    assert "stribeck_friction" in others(build_model("joint", ["coulomb_friction"]))


@pytest.mark.slow
def test_a_needless_effect_is_taken_out() -> None:
    """Of viscous friction, which is there, and a drift, which is not, only the friction stays."""
    hidden = {"viscous_friction.b_v": 1e-3}
    recordings = [gears(seed, **hidden) for seed in (41, 42, 43)]
    model = build_model("play", values=GEARS)
    *train, last = measured = experiments(model, recordings)
    task = Task.of(model, train, noise_of(measured))
    both = model.with_effect("bias_drift").with_effect("viscous_friction").replace(hidden)
    with ThreadPoolExecutor(2) as pool:
        base, level = full_fit(model, task), full_fit(both, task)
        unseen = Unseen(last, task, 0.25, pool)
        descent = [unseen.judge(fit.model) for fit in (base, base, level)]
        simpler, way = simplified(level, descent, unseen)
    assert simpler.model.effects == ("viscous_friction",)
    assert len(way) == 2
    assert way[-1].error == pytest.approx(1.0, abs=0.15)
    assert simpler.model.parameters["viscous_friction.b_v"].value == pytest.approx(1e-3, rel=0.05)
