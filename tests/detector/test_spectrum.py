"""fft, freq_fft, norm and mask of eqs. 8 and 10 on signals whose spectrum is known."""

from __future__ import annotations

import numpy as np
import pytest

from lostmotion.detector.errors import DetectorError
from lostmotion.detector.spectrum import amplitudes, bands, freq_fft, frequencies, normalised_mask, transform
from lostmotion.detector.window import DetectorSettings

SETTINGS = DetectorSettings(f_res_hz=58.0)


def test_a_sine_shows_with_its_amplitude() -> None:
    """A sine of 3 m/s² in the middle of bin 15 (60 Hz) shows 3 m/s² there, whatever motion lies under it."""
    time = np.arange(250) / 1000
    accel = 3 * np.sin(2 * np.pi * 60 * time + 0.4) + 9.8 + 20 * time - 300 * time**3
    spectrum = amplitudes(accel, transform(250, np.arange(126)))
    assert spectrum[15] == pytest.approx(3.0, rel=0.005)
    assert frequencies(250, 1000)[15] == 60.0
    assert spectrum[25:].max() < 0.02


def test_freq_fft_converts_frequency_to_bin() -> None:
    """At 200 Hz, 50 samples have bins of 4 Hz; a bin need not be whole."""
    assert freq_fft(52.0, 50, 200.0) == 13.0
    assert freq_fft(58.0, 50, 200.0) == 14.5


@pytest.mark.parametrize(("rate", "length"), [(200.0, 50), (500.0, 125), (1000.0, 250)])
def test_mask_is_half_open(rate: float, length: int) -> None:
    """Eq. 10: [52 Hz, 64 Hz) holds the bins at 52, 56 and 60 Hz, not the one at 64 Hz."""
    mask = bands(length, rate, SETTINGS).mask
    assert list(frequencies(length, rate)[mask]) == [52.0, 56.0, 60.0]


def test_mask_edges_between_bins_round_up() -> None:
    """A bin belongs to the mask when its own frequency lies in the interval: 53 to 63 Hz holds 56 and 60 Hz."""
    mask = bands(250, 1000.0, DetectorSettings(f_res_hz=58.0, f_width_hz=10.0)).mask
    assert list(frequencies(250, 1000.0)[mask]) == [56.0, 60.0]


def test_norm_band_ends_below_nyquist() -> None:
    """At 200 Hz the band 80-120 Hz has 80-96 Hz left; the bin at 100 Hz is the Nyquist frequency and stays out."""
    assert list(frequencies(50, 200.0)[bands(50, 200.0, SETTINGS).norm]) == [80.0, 84.0, 88.0, 92.0, 96.0]


def test_norm_leaves_the_mask_out() -> None:
    """Where norm and mask overlap, the mask's bins do not count in the norm."""
    chosen = bands(250, 1000.0, DetectorSettings(f_res_hz=58.0, f_norm_hz=60.0, f_norm_width_hz=40.0))
    assert list(frequencies(250, 1000.0)[chosen.norm]) == [40.0, 44.0, 48.0, 64.0, 68.0, 72.0, 76.0]


def test_norm_divides_by_the_mean_of_its_band() -> None:
    """The mask's bins of five windows, each over the mean amplitude of its own norm band."""
    accel = np.random.default_rng(1).normal(size=(5, 250))
    spectrum, chosen = amplitudes(accel, transform(250, np.arange(126))), bands(250, 1000.0, SETTINGS)
    by_hand = spectrum[:, chosen.mask] / spectrum[:, chosen.norm].mean(axis=1, keepdims=True)
    assert normalised_mask(accel, 1000.0, SETTINGS) == pytest.approx(by_hand, rel=1e-12)


@pytest.mark.filterwarnings("error")
def test_the_largest_numbers_have_a_norm_or_none() -> None:
    """Values far up give what small ones give, and NaN where the norm exceeds all numbers; without a warning."""
    accel = np.random.default_rng(1).choice([-1.7, 1.7], (5, 250))
    largest = normalised_mask(1e306 * accel, 1000.0, SETTINGS)
    assert largest == pytest.approx(normalised_mask(accel, 1000.0, SETTINGS), rel=1e-9)
    square = np.sign(np.sin(2 * np.pi * 100 * (np.arange(250) + 0.3) / 1000))
    assert np.isnan(normalised_mask(1.7e308 * square, 1000.0, SETTINGS)).all()


@pytest.mark.parametrize(
    ("rate", "settings", "words"),
    [
        (125.0, SETTINGS, "norm band 80-120 Hz has 0 bins"),
        (100.0, SETTINGS, "mask 52-64 Hz"),
        (1000.0, DetectorSettings(f_res_hz=58.0, f_width_hz=1.0), "holds no bin"),
        (1000.0, DetectorSettings(f_res_hz=5.0), "mask -1-11 Hz"),
    ],
)
def test_impossible_bands_are_refused_in_words(rate: float, settings: DetectorSettings, words: str) -> None:
    """A band that the sensor cannot resolve is named, with its limits."""
    with pytest.raises(DetectorError, match=words):
        bands(round(0.25 * rate), rate, settings)
