"""Noise levels that are known, found again in signals that hide them."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from lostmotion.lab.data.autoregression import NoiseModel, fit_autoregression
from lostmotion.lab.data.noise import quiet_noise
from lostmotion.lab.data.series import resolution
from tests.lab.simulated_gears import NOISE, RATE_HZ, moved

FloatArray = NDArray[np.float64]


def coloured(correlation: float, rms: float, rng: np.random.Generator, samples: int = 3200) -> FloatArray:
    """First-order noise, sample by sample from its definition."""
    x = np.empty(samples)
    x[0] = rng.normal(0, rms)
    for i in range(1, samples):
        x[i] = correlation * x[i - 1] + rng.normal(0, rms * np.sqrt(1 - correlation**2))
    return x


def ringing(rng: np.random.Generator, samples: int = 3200) -> FloatArray:
    """A slow motion, and a bar of 45-75 Hz that rings down after each of some 8 impacts a second, of both signs."""
    t = np.arange(samples) / RATE_HZ
    x = 2 * np.sin(2 * np.pi * 1.3 * t + 1) + np.sin(2 * np.pi * 2.7 * t)
    f = rng.uniform(45, 75)
    for at in np.cumsum(rng.uniform(0.04, 0.2, 60)):
        since = np.maximum(t - at, 0)
        x += (t > at) * rng.normal(0, 8) * np.exp(-0.012 * 2 * np.pi * f * since) * np.sin(2 * np.pi * f * since)
    return x


@pytest.mark.parametrize("rms", [0.05, 0.3])
@pytest.mark.parametrize("seed", range(4))
def test_white_noise_under_ringing_and_impacts(rms: float, seed: int) -> None:
    """White noise of 1 % of a ringing signal is found to a tenth."""
    rng = np.random.default_rng(seed)
    noise = rng.normal(0, rms, 3200)
    assert quiet_noise(ringing(rng) + noise).rms == pytest.approx(noise.std(), rel=0.1)


@pytest.mark.parametrize("hz", [40.0, 97.0, 160.0])
def test_a_hum_is_no_noise(hz: float) -> None:
    """White noise beside a steady hum of its size, such as a fan's, is found to a tenth, whatever else gears do."""
    run = moved(60, length=4.0)
    hum = 0.3 * np.sin(2 * np.pi * hz * run.time)
    assert quiet_noise(run.accel + NOISE * run.noise + hum).rms == pytest.approx(NOISE, rel=0.12)


@pytest.mark.parametrize(("correlation", "low", "high"), [(0.5, 0.75, 1.5), (0.9, 0.35, 1.3)])
def test_coloured_noise_under_ringing(correlation: float, low: float, high: float) -> None:
    """Coloured noise is told within the range that the docstring promises, also where most of it is slow."""
    for seed in range(3):
        rng = np.random.default_rng(seed)
        noise = coloured(correlation, 0.3, rng)
        assert low < quiet_noise(ringing(rng) + noise).rms / noise.std() < high


def test_quantisation_is_noise() -> None:
    """A signal without noise of its own, in counts of 0.01, has the noise of rounding: 0.01/sqrt(12)."""
    t = np.arange(4000) / RATE_HZ
    counts = np.round(3 * np.sin(2 * np.pi * 0.7 * t) / 0.01) * 0.01
    assert resolution(counts) == pytest.approx(0.01)
    assert quiet_noise(counts).rms == pytest.approx(0.01 / np.sqrt(12), rel=0.15)


def test_rest_is_not_free_of_noise() -> None:
    """A force that is exactly zero most of the time, in counts, still has the noise of its counts."""
    force = np.zeros(3000)
    force[1000:1010] = 2.5
    force[2000:2010] = 0.1
    assert quiet_noise(force).rms == pytest.approx(0.1 / np.sqrt(12))


def test_gaps_do_not_matter() -> None:
    """A signal with a quarter of its samples missing in blocks has the same noise."""
    rng = np.random.default_rng(5)
    x = ringing(rng) + rng.normal(0, 0.3, 3200)
    x[rng.integers(0, 3200 - 50, 16)[:, None] + np.arange(50)] = np.nan
    assert quiet_noise(x).rms == pytest.approx(0.3, rel=0.1)


def test_a_slow_column_is_seen_at_its_own_rate() -> None:
    """The angle of a servo at 100 Hz, in one of ten rows of a sensor at 1 kHz, has the noise that it has alone:
    0.5 mrad, not the 20 by which it moves from sample to sample."""
    times = np.arange(3000) / 1000
    angle = 0.6 * np.sin(2 * np.pi * times) + np.random.default_rng(7).normal(0, 5e-4, times.size)
    rows = np.where(np.arange(times.size) % 10 == 0, angle, np.nan)
    assert quiet_noise(rows).rms == quiet_noise(angle[::10]).rms == pytest.approx(5e-4, rel=0.2)


@pytest.mark.parametrize("seed", range(3))
def test_a_second_of_an_encoder_at_100_hz(seed: int) -> None:
    """120 samples, seen through the shortest windows: their noise of 1 mrad, not the resolution of 0.01 mrad alone."""
    times = np.arange(120) / 100
    angle = 0.3 * np.sin(2 * np.pi * times) + np.random.default_rng(seed).normal(0, 1e-3, 120)
    assert quiet_noise(np.round(angle, 5)).rms == pytest.approx(1e-3, rel=0.35)


def test_few_samples_give_a_number() -> None:
    """Ten samples are too few for windows; their differences tell the order of magnitude."""
    assert 0.03 < quiet_noise(np.random.default_rng(1).normal(5, 0.1, 10)).rms < 0.3


@pytest.mark.parametrize("correlation", [0.0, 0.5, 0.9])
def test_innovation_of_a_residual(correlation: float) -> None:
    """A residual that is noise gives back its size and correlation, and becomes white and of size 1."""
    rng = np.random.default_rng(7)
    residual = coloured(correlation, 0.3, rng, 8000)
    model = fit_autoregression([residual[:4000], residual[4000:]])
    assert model.rms == pytest.approx(0.3, rel=0.1)
    assert model.innovation == pytest.approx(0.3 * np.sqrt(1 - correlation**2), rel=0.03)
    white = model.whiten(residual)
    assert white.std() == pytest.approx(1.0, rel=0.03)
    assert abs(np.corrcoef(white[1:], white[:-1])[0, 1]) < 0.03


def test_outliers_and_gaps_in_a_residual() -> None:
    """A hundredth of wild samples and some gaps change the innovation by less than an eighth; gaps stay."""
    rng = np.random.default_rng(8)
    residual = coloured(0.6, 1.0, rng, 4000)
    residual[rng.integers(0, 4000, 40)] += 30.0
    residual[1000:1020] = np.nan
    model = fit_autoregression([residual])
    assert model.innovation == pytest.approx(0.8, rel=0.12)
    assert np.array_equal(np.isnan(model.whiten(residual)), np.isnan(residual))


def test_whitening_has_the_likelihood_of_the_covariance() -> None:
    """The sum of squares of whitened samples is x' C^-1 x with the exact covariance, also for the first samples."""
    model = NoiseModel(np.array([1.2, -0.5]), 0.7)
    x = np.random.default_rng(9).normal(size=12)
    gamma = model.autocovariance(11)
    covariance = gamma[np.abs(np.subtract.outer(np.arange(12), np.arange(12)))]
    assert np.sum(model.whiten(x) ** 2) == pytest.approx(x @ np.linalg.solve(covariance, x), rel=1e-6)


def test_autocovariance_and_density_of_first_order() -> None:
    """gamma_k = s² a^k/(1 - a²), and the density integrates to gamma_0."""
    model = NoiseModel(np.array([0.8]), 0.6)
    np.testing.assert_allclose(model.autocovariance(5), 0.8 ** np.arange(6), rtol=1e-9)
    frequency = np.linspace(0, 400, 4001)
    assert np.trapezoid(model.density(frequency, RATE_HZ), frequency) == pytest.approx(1.0, rel=1e-4)


def test_simulated_noise_is_the_model() -> None:
    """A long simulated segment has the model's autocovariance, from its first sample on."""
    model = NoiseModel(np.array([1.2, -0.5]), 0.7)
    x = model.simulate(np.random.default_rng(10), 200_000)
    found = [np.mean(x[: x.size - k] * x[k:]) for k in range(4)]
    np.testing.assert_allclose(found, model.autocovariance(3), atol=0.02 * model.rms**2)
    starts = [model.simulate(np.random.default_rng(seed), 5)[0] for seed in range(400)]
    assert np.std(starts) == pytest.approx(model.rms, rel=0.12)
