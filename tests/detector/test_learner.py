"""When the noise is learnt and reported, and that wear is not learnt as noise."""

from __future__ import annotations

import math
from collections.abc import Generator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from lostmotion.detector import learner as module
from lostmotion.detector import ringdown
from lostmotion.detector.background import Background, learn, learning
from lostmotion.detector.learner import Change, Learner, is_learning, settled
from lostmotion.detector.score import score_window
from lostmotion.detector.spectrum import _to_bands
from lostmotion.detector.window import DetectorSettings, FloatArray, Window
from tests.detector.test_background import LENGTH, RATE, SETTINGS, hum, rings


def white(rng: np.random.Generator, count: int) -> FloatArray:
    """Windows of white noise of 1 m/s²."""
    return np.asarray(rng.normal(size=(count, LENGTH)))


def changes_of(learner: Learner, windows: FloatArray) -> list[Change]:
    """The changes that the learner reports of windows."""
    return [change for window in windows if (change := learner.update(window)) is not None]


def test_what_is_calibrated_is_not_learnt_over() -> None:
    """A noise given, or a colour, stays; with neither the noise is learnt from the twentieth window on."""
    windows = white(np.random.default_rng(8810), 25)
    for given in (replace(SETTINGS, noise_ms2=3.0), replace(SETTINGS, noise_colour=(0.5,))):
        assert not is_learning(given)
        assert settled(windows, RATE, given) is given
    assert settled(windows[:19], RATE, SETTINGS) == SETTINGS
    assert settled(windows, RATE, SETTINGS).noise_ms2 == pytest.approx(1.0, rel=0.05)


@pytest.mark.slow
def test_the_first_noise_and_another_one_are_reported() -> None:
    """White noise of 1 m/s²: reported once; then hum begins: reported once more, with its frequency, within 600
    windows, and few windows score above the level from then on."""
    rng = np.random.default_rng(8811)
    learner = Learner(SETTINGS, RATE, LENGTH)
    (first,) = changes_of(learner, white(rng, 220))
    assert str(first).startswith("noise learnt: 1")
    assert first.is_first
    (other,) = changes_of(learner, hum(rng, 600))
    assert other.near_hz == pytest.approx(50, abs=3)
    assert (other.before, other.after) == (pytest.approx(1.0, rel=0.1), pytest.approx(math.sqrt(5), rel=0.1))
    assert np.mean(ringdown.scores(hum(rng, 200), RATE, learner.settings) > SETTINGS.level) < 0.01


def test_a_restart_goes_on() -> None:
    """A learner that resumes has the noise at once, continues to count, and reports nothing; windows of another length
    begin anew."""
    rng = np.random.default_rng(8812)
    learner, resumed, other = (Learner(SETTINGS, RATE, length) for length in (LENGTH, LENGTH, 200))
    changes_of(learner, white(rng, 60))
    assert learner.background is not None
    for one in (resumed, other):
        one.resume(learner.background, learner.seen)
    assert (resumed.settings, resumed.seen) == (learner.settings, 60)
    assert changes_of(resumed, white(rng, 60)) == []
    assert (other.settings, other.background) == (SETTINGS, None)


@pytest.mark.slow
def test_a_window_costs_one_round(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each window does at most three rounds of the work, and one once a noise is known; in the end the noise is that
    of ``learn``, which does all at once."""
    rounds = [0]

    def counted(*given: Any) -> Generator[None, None, Background | None]:
        work = learning(*given)
        while True:
            try:
                next(work)
            except StopIteration as finished:
                return finished.value
            rounds[-1] += 1
            yield

    monkeypatch.setattr(module, "learning", counted)
    windows = white(np.random.default_rng(8815), 110)
    learner = Learner(SETTINGS, RATE, LENGTH)
    for window in windows:
        is_known = learner.background is not None
        learner.update(window)
        assert rounds[-1] <= (1 if is_known else 3)
        rounds.append(0)
    assert sum(rounds) >= 10
    single = windows[:20].astype(np.float32).astype(float)
    first = Learner(SETTINGS, RATE, LENGTH)
    changes_of(first, windows[:35])
    assert first.background == learn(single, RATE, SETTINGS)


@pytest.mark.slow
def test_wear_is_not_learnt_away(monkeypatch: pytest.MonkeyPatch) -> None:
    """A life in which rings grow from 6 to 24 dB while the noise is followed: the worn windows score as with the noise
    of the first day, within 10 %, and no change of the noise is reported."""
    monkeypatch.setattr(module, "DUE", (20, 100))  # learnt again every hundred windows
    rng = np.random.default_rng(8813)
    learner = Learner(SETTINGS, RATE, LENGTH)
    changes_of(learner, white(rng, 100))
    first_day = learner.settings
    for snr in np.geomspace(2, 16, 7):
        assert changes_of(learner, white(rng, 100) + rings(rng, 100, snr)) == []
    worn = white(rng, 200) + rings(rng, 200, 12.0)
    then, now = (np.median(ringdown.scores(worn, RATE, known)) for known in (first_day, learner.settings))
    assert now == pytest.approx(then, rel=0.1)


def test_windows_without_information_are_not_used() -> None:
    """Silence, holes and another length do not count; a few missing samples do not matter."""
    learner = Learner(DetectorSettings(f_res_hz=58.0), RATE, LENGTH)
    rng = np.random.default_rng(8814)
    holed = white(rng, 1)[0]
    holed[::2] = np.nan
    for bad in (np.zeros(LENGTH), holed, np.zeros(10)):
        assert learner.update(bad) is None
    assert learner.seen == 0
    few = white(rng, 30)
    few[:, 7] = np.nan
    assert len(changes_of(learner, few)) == 1


def test_what_is_not_used_any_more_is_not_kept() -> None:
    """However often joints learn another noise, each keeps one bank, and all of them one transform to the bands."""
    rng = np.random.default_rng(8840)
    ringdown._banks.clear()
    _to_bands.cache_clear()
    learners = [Learner(SETTINGS, RATE, LENGTH) for _ in range(3)]
    for learner in learners:
        for k in range(4):
            learner.resume(Background((1.0 + k, 0.1), 100.0, LENGTH, 0.1), 100)
            score_window(Window("elbow", 0.0, 0.25, np.arange(LENGTH) / RATE, white(rng, 1)[0], RATE), learner.settings)
    assert len({learner.settings for learner in learners}) == 1
    assert len(ringdown._banks) == 1
    assert _to_bands.cache_info().currsize == 1
