"""The p-value of a gain on unseen data: its level where two models are equally wrong, and its power."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from lostmotion.lab.selection.validate import Judged, p_of_gain
from lostmotion.model.motion import FloatArray

SEGMENTS, SAMPLES = 4, 400


def coloured(rng: np.random.Generator) -> FloatArray:
    """(SEGMENTS, SAMPLES) of variance 1; a sample resembles the one before."""
    white = rng.normal(size=(SEGMENTS, SAMPLES + 100))
    return np.asarray(lfilter([np.sqrt(1 - 0.7**2)], [1, -0.7], white)[:, 100:])


def judged(r: FloatArray) -> Judged:
    """A model that leaves these residuals."""
    return Judged(tuple(r))


def test_equally_wrong_models_seem_better_as_rarely_as_the_level_says() -> None:
    """Of 600 pairs of models with errors of one law 5 % have p below 0.05, 10 % below 0.1."""
    rng, found = np.random.default_rng(5), []
    for _ in range(600):
        noise = coloured(rng)
        now, after = (judged(noise + 0.5 * coloured(rng)) for _ in range(2))
        found.append(p_of_gain(after, now, 1))
    assert np.mean(np.array(found) < 0.05) == pytest.approx(0.05, abs=0.025)
    assert np.mean(np.array(found) < 0.1) == pytest.approx(0.1, abs=0.035)


def test_a_gain_is_significant_and_none_is_not() -> None:
    """A tenth less error is beyond doubt, the same residual is no gain at all, nor is that of a model that is lost; of
    ten effects the best has to pay."""
    rng = np.random.default_rng(6)
    noise, wrong = coloured(rng), coloured(rng)
    now, after = judged(noise + 0.5 * wrong), judged(noise)
    assert p_of_gain(after, now, 1) < 1e-6
    assert p_of_gain(after, now, 10) == pytest.approx(10 * p_of_gain(after, now, 1))
    assert p_of_gain(now, now, 1) >= 0.5
    assert p_of_gain(now, after, 1) > 0.999
    assert p_of_gain(judged(np.full((SEGMENTS, SAMPLES), np.inf)), now, 1) == 1.0
