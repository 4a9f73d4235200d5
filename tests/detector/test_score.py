"""Eq. 8: what scores high, what scores low, and what cannot be scored."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal.windows import tukey

from lostmotion.detector.errors import DetectorError
from lostmotion.detector.score import batch, score, score_window, validate
from lostmotion.detector.spectrum import bands
from lostmotion.detector.window import DetectorSettings, Window
from tests.detector.synthetic import Scene

SETTINGS = DetectorSettings(f_res_hz=58.0, statistic="band")


def window(accel: np.ndarray, rate_hz: float = 1000.0, excitation: float = 10.0) -> Window:
    """A window of the elbow that starts at 3 s."""
    time = 3.0 + np.arange(accel.size) / rate_hz
    return Window("elbow", 3.0, accel.size / rate_hz, time, accel, rate_hz, excitation)


def test_score_is_the_sum_over_the_mask() -> None:
    """Eq. 8 by hand: cubic, Tukey window, FFT, the amplitudes at 52, 56 and 60 Hz over the mean from 80 to 116 Hz."""
    accel = np.random.default_rng(0).normal(size=250)
    index = np.arange(250)
    rest = accel - np.polynomial.Polynomial.fit(index, accel, 3)(index)
    spectrum = np.abs(np.fft.rfft(rest * tukey(501, 0.25)[1::2]))
    by_hand = spectrum[13:16].sum() / spectrum[20:30].mean()
    assert score(accel, 1000.0, SETTINGS) == pytest.approx(float(by_hand), rel=1e-12)
    assert bands(250, 1000.0, SETTINGS).mask == slice(13, 16)


@pytest.mark.parametrize("rate", [200.0, 1000.0])
def test_white_noise_scores_the_number_of_bins(rate: float) -> None:
    """The median score of white noise is 3, the bins of the mask, and less than 1 % lie above the default level."""
    noise = np.random.default_rng(2).normal(size=(4000, round(0.25 * rate)))
    scores = batch(noise, rate, SETTINGS)
    assert np.median(scores) == pytest.approx(3.0, abs=0.1)
    assert np.mean(scores > SETTINGS.level) < 0.01


@pytest.mark.parametrize(("rate", "missed"), [(200.0, 0.06), (1000.0, 0.01)])
def test_worn_windows_stand_above_healthy_ones(rate: float, missed: float) -> None:
    """Ring-downs of 6 times the noise: the default level misses few, and the medians lie far apart."""
    rng = np.random.default_rng(3)
    scene = Scene()
    healthy = batch(scene.healthy(rng, 1000, rate, 0.25), rate, SETTINGS)
    worn = batch(scene.worn(rng, 1000, rate, 0.25), rate, SETTINGS)
    assert np.mean(worn <= SETTINGS.level) < missed
    assert np.median(worn) > 4 * np.median(healthy)


@given(scale=st.floats(1e-6, 1e6), offset=st.floats(-100, 100), seed=st.integers(0, 1000))
def test_score_knows_no_scale_and_no_offset(scale: float, offset: float, seed: int) -> None:
    """The unit of the acceleration, and gravity, do not matter."""
    accel = np.random.default_rng(seed).normal(size=250)
    assert score(scale * (accel + offset), 1000.0, SETTINGS) == pytest.approx(score(accel, 1000.0, SETTINGS), rel=1e-6)


def test_batch_scores_each_window_alone() -> None:
    """Many windows at once, across the chunks, give what each gives on its own."""
    accel = np.random.default_rng(4).normal(size=(4100, 50))
    scores = batch(accel, 200.0, SETTINGS)
    assert scores.shape == (4100,)
    for index in (0, 4095, 4096, 4099):
        assert scores[index] == pytest.approx(score(accel[index], 200.0, SETTINGS), rel=1e-12)
    assert batch(np.empty((0, 50)), 200.0, SETTINGS).shape == (0,)


@pytest.mark.parametrize("value", [0.0, 9.81, -1e6])
def test_silence_scores_nan_not_infinity(value: float) -> None:
    """A sensor with a constant reading has no norm: the score is NaN, quality flat, and no impact."""
    result = score_window(window(np.full(250, value)), SETTINGS)
    assert math.isnan(result.score)
    assert (result.impact, result.quality) == (False, "flat")


@pytest.mark.parametrize("start", [1e7, 1e8, 4e9])
def test_a_clock_has_no_score(start: float) -> None:
    """A column of microseconds with 4 µs of jitter, or of milliseconds: implausible, whichever statistic is the score;
    a noise of 1 mm/s² under gravity is none."""
    rng = np.random.default_rng(8)
    ticks = start + 4 * np.round(250.0 * np.arange(250) + rng.normal(0, 0.5, 250))
    for clock in (ticks, np.floor(start / 1000 + 1.25 * np.arange(250))):
        found = score_window(window(clock), SETTINGS)
        assert (math.isnan(found.score), found.quality) == (True, "implausible")
    assert score_window(window(9.81 + 1e-3 * rng.normal(size=250)), SETTINGS).score > 0


def test_a_window_becomes_a_score() -> None:
    """The window's own values go over to the score, the level comes from the settings."""
    time = np.arange(250) / 1000
    noise = 0.1 * np.random.default_rng(5).normal(size=250)
    ringing = score_window(window(np.exp(-4.4 * time) * np.sin(2 * np.pi * 58 * time) + noise), SETTINGS)
    assert (ringing.joint, ringing.time, ringing.duration, ringing.excitation) == ("elbow", 3.0, 0.25, 10.0)
    assert (ringing.level, ringing.impact, ringing.quality) == (8.0, True, "ok")
    assert ringing.score > 30
    assert math.isnan(ringing.play)
    assert not score_window(window(noise), SETTINGS).impact


def test_a_score_holds_both_statistics() -> None:
    """Whichever statistic is the score, the other one is there too, as it would be alone, also with samples missing."""
    accel = np.random.default_rng(7).normal(size=250)
    holed = np.where(np.arange(250) % 100 == 7, np.nan, accel)
    rings = replace(SETTINGS, statistic="ringdown")
    for values in (accel, holed):
        by_band, by_ring = score_window(window(values), SETTINGS), score_window(window(values), rings)
        assert (by_band.band, by_band.ringdown) == (by_band.score, by_ring.score)
        assert (by_ring.band, by_ring.ringdown) == (by_band.score, by_ring.score)
        assert by_band.score != by_ring.score


def test_a_statistic_that_cannot_be_computed_is_unknown() -> None:
    """Two periods of the bar are too short for ring-down, 150 Hz too slow for eq. 8's norm: the other statistic stands
    alone; the one that is the score still raises."""
    noise = np.random.default_rng(8).normal(size=50)
    short = replace(SETTINGS, f_width_hz=40.0, f_norm_hz=200.0, f_norm_width_hz=200.0)
    assert math.isnan(score_window(window(noise[:35]), short).ringdown)
    assert score_window(window(noise[:35]), short).score > 0
    slow = replace(SETTINGS, statistic="ringdown")
    assert math.isnan(score_window(window(noise, 150.0), slow).band)
    assert score_window(window(noise, 150.0), slow).score > 0
    with pytest.raises(DetectorError):
        score_window(window(noise, 150.0), SETTINGS)


def test_few_missing_samples_are_bridged_and_many_are_not() -> None:
    """3 of 250 missing change the score little and are named; 60 missing give NaN."""
    time = np.arange(250) / 1000
    accel = np.exp(-4.4 * time) * np.sin(2 * np.pi * 58 * time) + 0.1 * np.random.default_rng(6).normal(size=250)
    whole = score_window(window(accel), SETTINGS)
    holed = accel.copy()
    holed[[40, 90, 91, 120, 160, 200]] = np.nan
    few = score_window(window(holed), SETTINGS)
    assert few.quality == "gappy"
    assert few.score == pytest.approx(whole.score, rel=0.25)
    holed[60:120] = np.nan
    many = score_window(window(holed), SETTINGS)
    assert (math.isnan(many.score), many.impact, many.quality) == (True, False, "gappy")


@pytest.mark.parametrize("rate", [200.0, 500.0, 1000.0])
def test_default_settings_are_valid(rate: float) -> None:
    """The defaults serve every sensor that is supported, with the window given or not."""
    validate(SETTINGS, rate)
    validate(DetectorSettings(f_res_hz=58.0, window_s=None), rate)


@pytest.mark.parametrize(
    ("settings", "rate", "words"),
    [
        (SETTINGS, 150.0, "lower f_norm_hz"),
        (DetectorSettings(f_res_hz=-58.0), 1000.0, "f_res_hz is -58"),
        (DetectorSettings(f_res_hz=math.nan), 1000.0, "f_res_hz is nan"),
        (DetectorSettings(f_res_hz=58.0, zeta=1.2), 1000.0, "zeta is 1.2"),
        (DetectorSettings(f_res_hz=58.0, window_s=0.0), 1000.0, "window_s is 0"),
        (DetectorSettings(f_res_hz=58.0, level=0.0), 1000.0, "level is 0"),
    ],
)
def test_bad_settings_are_named(settings: DetectorSettings, rate: float, words: str) -> None:
    """The message has the setting and its value."""
    with pytest.raises(DetectorError, match=words):
        validate(settings, rate)
