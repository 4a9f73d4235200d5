"""What a fit predicts of unseen segments: the test of two models, lost segments, starts that another model knows."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from lostmotion.lab import policy
from lostmotion.lab.data.experiment import experiments
from lostmotion.lab.data.noise import noise_of
from lostmotion.lab.data.whiteness import is_structured
from lostmotion.lab.fitting.strategy import full_fit
from lostmotion.lab.gears.unseen import Unseen, Validation, compared, exceeds_noise
from lostmotion.lab.shooting.continuation import residuals
from lostmotion.lab.shooting.task import Task
from lostmotion.model import build_model
from lostmotion.model.motion import FloatArray
from tests.lab.simulated_gears import GEARS, gears

SEGMENTS, SAMPLES = 4, 400
MODEL = build_model("play", values=GEARS)


def coloured(rng: np.random.Generator) -> FloatArray:
    """(SEGMENTS, SAMPLES) of variance 1; a sample resembles the one before."""
    white = rng.normal(size=(SEGMENTS, SAMPLES + 100))
    return np.asarray(lfilter([np.sqrt(1 - 0.7**2)], [1, -0.7], white)[:, 100:])


def judged(r: FloatArray) -> Validation:
    """A model that leaves these residuals."""
    return Validation(MODEL, tuple(r))


def test_equally_wrong_models_seem_better_as_rarely_as_the_level_says() -> None:
    """Of 600 pairs of models with errors of one law 5 % have p below 0.05, 10 % below 0.1."""
    rng, found = np.random.default_rng(5), []
    for _ in range(600):
        noise = coloured(rng)
        now, after = (judged(noise + 0.5 * coloured(rng)) for _ in range(2))
        found.append(compared(now, after).p_value)
    assert np.mean(np.array(found) < 0.05) == pytest.approx(0.05, abs=0.025)
    assert np.mean(np.array(found) < 0.1) == pytest.approx(0.1, abs=0.035)


def test_a_gain_is_significant_and_none_is_not() -> None:
    """A tenth less error is beyond doubt, the same residual is no gain at all, nor is that of a model that is lost."""
    rng = np.random.default_rng(6)
    noise, wrong = coloured(rng), coloured(rng)
    now, after = judged(noise + 0.5 * wrong), judged(noise)
    assert compared(now, after).p_value < 1e-6
    assert compared(now, after).gain == pytest.approx(0.2, abs=0.05)
    assert compared(now, now).p_value >= 0.5
    assert compared(after, now).p_value > 0.999
    lost = compared(now, judged(np.full((SEGMENTS, SAMPLES), np.inf)))
    assert (lost.p_value > 0.999, lost.gain < 0) == (True, True)


def test_a_lost_segment_counts_but_not_without_end() -> None:
    """One model loses one of four segments: it is worse by three times the usual error there at most, whatever chaos
    makes of it."""
    noise = coloured(np.random.default_rng(7))
    good = judged(noise)
    gains = [compared(judged(noise * np.array([1, 1, 1, loss])[:, None]), good).gain for loss in (50.0, 1e9)]
    most = policy.MISSED**2 / 4
    assert gains == pytest.approx(2 * [1 - 1 / (0.75 + most)], abs=0.05)


def test_a_lost_segment_makes_no_longer_blocks() -> None:
    """One of four segments is lost by both models: of the others there are as many blocks as without it, and a third
    of the error is as significant as before."""
    rng = np.random.default_rng(9)
    noise, loss = coloured(rng), np.array([1e3, 1, 1, 1])[:, None]
    whole = compared(judged(3 * noise), judged(noise))
    lost = compared(judged(3 * noise * loss), judged(noise * loss))
    assert lost.block.max() == pytest.approx(whole.block.max(), rel=0.1)
    assert whole.block.max() > 40
    assert max(whole.p_value, lost.p_value) < 1e-15


@pytest.mark.slow
def test_what_is_left_is_told_by_the_segments_that_are_followed_best() -> None:
    """With its Coulomb friction nothing is left of gears, although a segment of unseen data begins a little off."""
    *train, last = held = experiments(MODEL, [gears(seed, **{"coulomb_friction.tau_c": 5e-4}) for seed in (65, 66, 67)])
    task = Task.of(MODEL, train, noise_of(held))
    with ThreadPoolExecutor(2) as pool:
        unseen = Unseen(last, task, 0.5, pool)
        level = full_fit(MODEL.with_effect("coulomb_friction").replace({"coulomb_friction.tau_c": 5e-4}), task)
        found = unseen.validate(level.model)
    assert is_structured([found.parts[i] for i in found.kept])
    assert not exceeds_noise(found)


def test_segments_at_the_noise_are_not_searched_for_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """A model that follows from the states of another one begins there, with no scan; the errors are those of a scan.
    One that does not is searched for as well as if it were alone."""
    (experiment,) = experiments(MODEL, [gears(64, 1.0)])
    task = Task.of(MODEL, [experiment], {"accel": 0.2})
    near, far = MODEL.replace({"k": 1.0005 * GEARS["k"]}), MODEL.replace({"d": 0.7 * GEARS["d"]})
    with ThreadPoolExecutor(2) as pool:
        unseen = Unseen(experiment, task, 0.25, pool)
        known, alone, lost = (unseen.validate(model) for model in (MODEL, near, far))
        assert np.all(unseen.validate(far, known).errors < 1.01 * lost.errors)
        monkeypatch.setattr("lostmotion.lab.gears.unseen.with_initial_states", None)
        np.testing.assert_allclose(unseen.validate(near, known).errors, alone.errors, rtol=0.01)
    assert np.any(lost.errors > policy.LOST)


def test_a_lost_segment_begins_where_another_model_follows_it() -> None:
    """Of two models that are the same, one is made to begin far off in a segment: it borrows the other one's start."""
    (experiment,) = experiments(MODEL, [gears(64, 1.0)])
    task = Task.of(MODEL, [experiment], {"accel": 0.2})
    with ThreadPoolExecutor(2) as pool:
        unseen = Unseen(experiment, task, 0.25, pool)
        good = unseen.validate(MODEL)
        segments = list(good.segments)
        off = segments[1].start + np.array([0.004, 3.0, 0.0, 0.0])
        segments[1] = segments[1].starting(off)
        poor = replace(good, segments=tuple(segments), parts=tuple(residuals(MODEL, segments, task.substep_s)))
        again = unseen.with_better_states(poor, good)
    assert poor.errors[1] > 3 * good.errors[1]
    np.testing.assert_allclose(again.errors, good.errors, rtol=1e-3)
    assert good.error == pytest.approx(1.0, abs=0.15)
