"""The noise estimated from windows: with rings and without, with hum, white and coloured."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from lostmotion.detector import ringdown
from lostmotion.detector.background import MEMORY, Background, applied, distance, followed, learn
from lostmotion.detector.errors import DetectorError
from lostmotion.detector.whitening import Noise
from lostmotion.detector.window import DetectorSettings, FloatArray
from tests.detector.synthetic import ring

SETTINGS = DetectorSettings(f_res_hz=58.0)
RATE, LENGTH = 1000.0, 250
RED = Noise(1.0, (-0.6,))
"""x = 0.6 x1 + e."""


def red(rng: np.random.Generator, count: int) -> FloatArray:
    """Windows of that noise."""
    out = rng.normal(size=(count, LENGTH + 100))
    for i in range(1, LENGTH + 100):
        out[:, i] += 0.6 * out[:, i - 1]
    return out[:, 100:]


def hum(rng: np.random.Generator, count: int) -> FloatArray:
    """Mains hum of 50 Hz, twice as loud as the white noise beside it."""
    phase = rng.uniform(0, 2 * math.pi, (count, 1))
    line = 2 * math.sqrt(2) * np.sin(2 * math.pi * 50.0 * np.arange(LENGTH) / RATE + phase)
    return np.asarray(rng.normal(size=(count, LENGTH)) + line)


def rings(rng: np.random.Generator, count: int, snr: float) -> FloatArray:
    """A ring in each window, from 5 to 90 ms on, its energy snr² in units of the noise's variance."""
    time = np.arange(LENGTH) / RATE
    waves = np.array([ring(time, np.array([start]), 58.0, 0.012)[0] for start in rng.uniform(0.005, 0.09, count)])
    return np.asarray(rng.choice((-1, 1), (count, 1)) * snr * waves / np.linalg.norm(waves, axis=1)[:, None])


@pytest.mark.parametrize("snr", [0.0, 8.0, 12.0])
def test_noise_is_that_of_the_process_with_rings_and_without(snr: float) -> None:
    """x = 0.6 x1 + e, in 100 windows without rings, with rings at 18 dB and at 21.6 dB: the learnt noise predicts it as
    well as itself, within 0.01 nats a sample."""
    rng = np.random.default_rng(8800)
    found = learn(red(rng, 100) + rings(rng, 100, snr), RATE, SETTINGS)
    assert found is not None
    assert distance(RED, found.noise) < 0.01
    assert (found.ringing > 0.9) == (snr > 0)


def test_rings_are_not_learnt_as_noise() -> None:
    """Of a joint that is worn from the first day on the windows score as with the true noise, within 10 %."""
    rng = np.random.default_rng(8801)
    worn = rng.normal(size=(100, LENGTH)) + rings(rng, 100, 8.0)
    found = learn(worn, RATE, SETTINGS)
    assert found is not None
    fresh = rng.normal(size=(200, LENGTH)) + rings(rng, 200, 8.0)
    truth = np.median(ringdown.scores(fresh, RATE, replace(SETTINGS, noise_ms2=1.0)))
    assert np.median(ringdown.scores(fresh, RATE, applied(found, SETTINGS))) == pytest.approx(truth, rel=0.1)


@pytest.mark.parametrize("snr", [0.0, 7.0])
def test_hum_is_learnt_as_noise(snr: float) -> None:
    """Hum beside the resonance, without rings and with: fewer than 3 % of fresh windows with hum alone exceed the
    level, all of which do without what was learnt, and nine of ten windows with a ring at 20 dB do."""
    rng = np.random.default_rng(8802)
    found = learn(hum(rng, 100) + rings(rng, 100, snr), RATE, SETTINGS)
    assert found is not None
    known = applied(found, SETTINGS)
    alone = hum(rng, 1000)
    assert np.mean(ringdown.scores(alone, RATE, SETTINGS) > SETTINGS.level) > 0.9
    assert np.mean(ringdown.scores(alone, RATE, known) > SETTINGS.level) < 0.03
    assert np.mean(ringdown.scores(alone + rings(rng, 1000, 10.0), RATE, known) > SETTINGS.level) > 0.9


def test_loud_rings_in_every_window_tell_nothing() -> None:
    """Rings a hundred times as loud as the noise, and what no ring explains of them: None."""
    rng = np.random.default_rng(8803)
    loud = rings(rng, 60, 100.0)
    blurred = loud + 0.3 * np.roll(loud, 7, axis=1) * rng.normal(size=(60, 1))
    assert learn(blurred + rng.normal(size=loud.shape), RATE, SETTINGS) is None


def test_too_little_is_an_error() -> None:
    """Fewer than 20 windows, or holes in them, are refused; windows of one value give no noise."""
    for windows in (np.zeros((19, LENGTH)), np.full((20, LENGTH), np.nan)):
        with pytest.raises(DetectorError, match="expected at least 20"):
            learn(windows, RATE, SETTINGS)
    assert learn(np.full((20, LENGTH), 9.81), RATE, SETTINGS) is None


def test_distance_by_hand() -> None:
    """White noise half again as loud: (1.5² - 1 - ln 1.5²) / 2 nats a sample; none from itself."""
    assert distance(Noise(1.5, ()), Noise(1.0, ())) == pytest.approx((2.25 - 1 - math.log(2.25)) / 2)
    assert distance(RED, RED) == pytest.approx(0.0, abs=1e-12)


def test_the_past_counts_for_a_thousand_windows() -> None:
    """Variances 1 of 3000 windows and 1.1 of 100 make (1000 + 110) / 1100; twice as loud is another noise."""
    past, now, other = (Background((power, 0.0), count, 250, 0.0) for power, count in ((1, 3000), (1.1, 100), (4, 100)))
    both, changed = followed(past, now)
    assert not changed
    assert both.covariance[0] == pytest.approx((MEMORY + 110) / (MEMORY + 100))
    assert both.windows == MEMORY + 100
    assert followed(past, other) == (other, True)
    assert followed(None, now) == (now, False)
