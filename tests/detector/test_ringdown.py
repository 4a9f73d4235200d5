"""The detector that knows the ring-down, held against noise, rings and eq. 8."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from lostmotion.detector import ringdown
from lostmotion.detector.errors import DetectorError
from lostmotion.detector.score import batch, score_window, validate
from lostmotion.detector.whitening import fit_noise
from lostmotion.detector.window import DetectorSettings, Window
from tests.detector.synthetic import Scene, ring

SETTINGS = DetectorSettings(f_res_hz=58.0, statistic="ringdown")


def missed(healthy: np.ndarray, worn: np.ndarray, false_alarm: float = 0.01) -> float:
    """Share of the worn scores below the level that lets so many of the healthy ones through."""
    return float(np.mean(worn <= np.quantile(healthy, 1 - false_alarm)))


@pytest.mark.slow
def test_level_keeps_its_promise_in_white_noise() -> None:
    """Fewer than one window in a thousand exceeds the default level, whatever the noise's size, known or not."""
    rng = np.random.default_rng(8000)
    for rate in (200.0, 1000.0):
        noise = rng.normal(0, 0.3, (10_000, round(rate / 4)))
        for settings in (SETTINGS, replace(SETTINGS, noise_ms2=0.3)):
            assert np.mean(ringdown.scores(noise, rate, settings) > settings.level) < 1e-3


def test_score_is_the_amplitude_over_its_deviation() -> None:
    """A lone ring of energy E in noise of known variance s² scores sqrt(E) / s, less what the search costs."""
    rng = np.random.default_rng(8001)
    time = np.arange(250) / 1000
    wave = ring(time, np.array([0.05]), 58.0, 0.012)[0]
    for snr in (10.0, 20.0, 40.0):
        windows = snr * wave / np.linalg.norm(wave) + rng.normal(size=(200, 250))
        calm = replace(SETTINGS, noise_ms2=1.0)
        found = np.median(ringdown.scores(windows, 1000.0, calm))
        # Student's t of n degrees grows like its logarithm: total ring and noise, of which the ring explains snr².
        n = ringdown.TRUST + 250 - ringdown.bank(250, 1000.0, calm).slow.shape[1]
        log_likelihood = n / 2 * math.log1p(snr**2 / n) - 2 * ringdown.PENALTY - math.log(26)
        expected = math.sqrt(n * math.expm1(2 * log_likelihood / n))
        assert found == pytest.approx(expected, rel=0.08)


def test_slow_motion_does_not_change_the_score() -> None:
    """A motion of the arm a thousand times as large as the noise, up to 3 Hz, changes no score by more than 0.2."""
    rng = np.random.default_rng(8002)
    time = np.arange(250) / 1000
    noise = rng.normal(size=(500, 250))
    swing = 1000 * np.sin(2 * np.pi * rng.uniform(0.5, 3, (500, 1)) * time + rng.uniform(0, 6, (500, 1)))
    calm, moving = (ringdown.scores(windows, 1000.0, SETTINGS) for windows in (noise, noise + swing))
    assert np.abs(moving - calm).max() < 0.2


@pytest.mark.parametrize("rate", [200.0, 1000.0])
def test_fewer_misses_than_eq_8(rate: float) -> None:
    """In a scene with motion, gravity, coloured noise, rebounds and a slightly wrong resonance it misses at most two
    thirds of what eq. 8 misses."""
    rng = np.random.default_rng(8003)
    scene = Scene(impact=4.0)
    healthy, worn = scene.healthy(rng, 2000, rate, 0.25), scene.worn(rng, 2000, rate, 0.25)
    band = DetectorSettings(f_res_hz=58.0, statistic="band")
    ours = missed(batch(healthy, rate, SETTINGS), batch(worn, rate, SETTINGS))
    assert ours < 0.67 * missed(batch(healthy, rate, band), batch(worn, rate, band))


def test_known_colour_lowers_the_misses_on_a_shaken_bar() -> None:
    """Where the healthy bar is shaken by a rough gear its hum lies in the ring's own band; the noise's colour, learnt
    from other healthy windows, separates them."""
    rng = np.random.default_rng(8004)
    scene = Scene(impact=6.0, shaken=1.0)
    length = 250
    slow = ringdown.bank(length, 1000.0, SETTINGS).slow
    learnt = scene.healthy(rng, 1000, 1000.0, 0.25)
    taught = replace(SETTINGS, noise_colour=fit_noise(learnt, slow).colour)
    healthy, worn = scene.healthy(rng, 2000, 1000.0, 0.25), scene.worn(rng, 2000, 1000.0, 0.25)
    with_colour, without = (
        missed(batch(healthy, 1000.0, settings), batch(worn, 1000.0, settings)) for settings in (taught, SETTINGS)
    )
    assert with_colour < 0.6 * without


def test_missing_samples_are_drawn_from_the_ring() -> None:
    """A seventh of the samples missing at random: the score stays within a tenth of that of the whole window."""
    rng = np.random.default_rng(8005)
    time = np.arange(100) / 400
    accel = 5 * ring(time, np.array([0.06]), 58.0, 0.012)[0] + 3 * time + rng.normal(0, 0.3, 100)
    holes = np.where(rng.random(100) < 0.14, np.nan, accel)
    whole, holey = (
        score_window(Window("elbow", 0.0, 0.25, time, values, 400.0), SETTINGS).score for values in (accel, holes)
    )
    assert holey == pytest.approx(whole, rel=0.1)


def test_silence_has_no_score() -> None:
    """A window of one value, or of zeros, scores NaN."""
    assert np.isnan(ringdown.scores(np.array([np.zeros(250), np.full(250, 9.81)]), 1000.0, SETTINGS)).all()


def test_settings_that_cannot_work_are_refused() -> None:
    """A resonance beyond half of the rate, a window of two periods, an unstable noise: each is an error."""
    for settings, words in (
        (replace(SETTINGS, f_res_hz=120.0), "expected less than half of the rate"),
        (replace(SETTINGS, window_s=0.04), "raise window_s"),
        (replace(SETTINGS, noise_colour=(1.5,)), "between -1 and 1"),
    ):
        with pytest.raises(DetectorError, match=words):
            validate(settings, 200.0)


def test_norm_band_is_not_needed() -> None:
    """A band for eq. 8's norm beyond the sensor's rate does not matter here."""
    settings = replace(SETTINGS, f_norm_hz=5000.0)
    validate(settings, 200.0)
    with pytest.raises(DetectorError, match="norm band"):
        validate(replace(settings, statistic="band"), 200.0)
