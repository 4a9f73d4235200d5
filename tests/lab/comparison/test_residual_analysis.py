"""Whiteness tests, maps and spectra: false alarms on noise, and what they find in residuals of known structure."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from lostmotion.lab.comparison.bands import spectra
from lostmotion.lab.data.autoregression import NoiseModel, fit_autoregression
from lostmotion.lab.data.whiteness import autocorrelation, cross_correlation, fit_percent
from lostmotion.lab.discrepancy.residual_maps import ResidualMap, finding, residual_maps

FloatArray = NDArray[np.float64]
RATE_HZ = 800.0
TIME = np.arange(1600) / RATE_HZ
INPUT = np.sin(2 * np.pi * 1.3 * TIME) + np.sin(2 * np.pi * 2.1 * TIME + 1)
TRIALS = 120


def noises(correlation: float) -> list[FloatArray]:
    """Segments of first-order noise of innovation 1."""
    rng = np.random.default_rng(int(100 * correlation))
    model = NoiseModel(np.array([correlation]), 1.0)
    return [model.simulate(rng, TIME.size) for _ in range(TRIALS)]


def test_fit_percent() -> None:
    """100 for the measurement itself, 0 for its mean, negative for worse; gaps are left out."""
    y = np.array([1.0, 2.0, np.nan, 3.0, 6.0])
    assert fit_percent(y, np.nan_to_num(y)) == 100.0
    assert fit_percent(y, np.full(5, 3.0)) == pytest.approx(0.0)
    assert fit_percent(y, np.full(5, 3.0) + 2 * (3.0 - np.nan_to_num(y))) < 0


def test_white_noise_passes_the_whiteness_test() -> None:
    """Ljung-Box cries wolf in 5 % of cases; 25 correlations leave their common bound in 5 % of cases."""
    found = [autocorrelation(x) for x in noises(0.0)]
    assert np.mean([one.significant for one in found]) == pytest.approx(0.05, abs=0.05)
    assert np.mean([np.any(np.abs(one.values) > one.bound) for one in found]) == pytest.approx(0.05, abs=0.05)


def test_coloured_noise_fails_the_whiteness_test() -> None:
    """Noise with a correlation of 0.2 is never taken for white, and its first correlation is told."""
    found = [autocorrelation(x) for x in noises(0.2)]
    assert all(one.significant for one in found)
    assert np.mean([one.values[0] for one in found]) == pytest.approx(0.2, abs=0.01)


@pytest.mark.slow
@pytest.mark.parametrize("correlation", [0.0, 0.5, 0.9])
def test_noise_is_independent_of_the_input(correlation: float) -> None:
    """However coloured the residual, it is said to follow an unrelated smooth input in some 5 % of cases."""
    found = [cross_correlation(x, INPUT).p_value < 0.05 for x in noises(correlation)]
    assert np.mean(found) == pytest.approx(0.05, abs=0.05)


def test_residual_that_follows_the_input() -> None:
    """A share of the input a fifth of the noise's size, three samples late, is seen in white and in coloured noise."""
    late = 0.2 * np.concatenate((np.zeros(3), INPUT[:-3]))
    for correlation in (0.0, 0.5):
        found = [cross_correlation(x + late, INPUT).significant for x in noises(correlation)[:20]]
        assert np.mean(found) >= 0.8


@pytest.mark.parametrize("correlation", [0.0, 0.9])
def test_maps_of_noise_are_flat(correlation: float) -> None:
    """A residual of coloured noise has a significant map over any of three variables in at most some 5 % of cases."""
    segments = noises(correlation)
    variables = {"command": [INPUT, INPUT], "rate": [np.gradient(INPUT)] * 2, "time": [TIME, TIME]}
    found = [residual_maps(segments[i : i + 2], variables) for i in range(0, TRIALS, 2)]
    assert np.mean([any(one.significant for one in maps) for maps in found]) < 0.12
    p = np.array([one.p_value for maps in found for one in maps])
    assert np.mean(p < 0.5) == pytest.approx(0.5, abs=0.12)


def test_map_shows_the_law() -> None:
    """A hidden 0.5 sign(rate) in noise of 1 comes first, with its share of the error and its two levels."""
    rate = np.gradient(INPUT, TIME)
    residuals = [0.5 * np.sign(rate) + x for x in noises(0.3)[:3]]
    first, *_ = residual_maps(residuals, {"command": [INPUT] * 3, "rate": [rate] * 3, "time": [TIME] * 3})
    assert first.variable == "rate"
    assert first.significant
    assert first.explained == pytest.approx(0.25 / (0.25 + 1 / (1 - 0.09)), abs=0.05)
    clear = np.abs(first.x) > 3
    level = np.where(first.x > 0, 0.5, -0.5)[clear]
    assert np.mean(np.abs(first.mean[clear] - level) < first.half_width[clear]) > 0.7


def test_band_of_a_hidden_tone() -> None:
    """A tone of 0.2 at 100 Hz in noise of 1 stands out in its band alone, with its size."""
    tone = 0.2 * np.sqrt(2) * np.sin(2 * np.pi * 100 * TIME)
    residuals = [tone + x for x in noises(0.0)[:3]]
    found = spectra(residuals, residuals, RATE_HZ, NoiseModel.white(1.0))
    (band,) = [one for one in found.bands if one.stands_out]
    assert band.low_hz <= 100 < band.high_hz
    assert band.residual**2 - band.noise**2 == pytest.approx(0.04, abs=0.03)


def test_bands_of_noise_do_not_stand_out() -> None:
    """With noise that is known, hardly ever any band does."""
    segments = noises(0.5)
    noise = fit_autoregression(segments)
    found = [spectra(segments[i : i + 3], segments[i : i + 3], RATE_HZ, noise) for i in range(0, TRIALS, 3)]
    assert np.mean([any(band.stands_out for band in one.bands) for one in found]) <= 0.06


def test_what_explains_half_of_a_residual_comes_first() -> None:
    """A law with noise of its own size explains half; a variable without a law explains nothing."""
    rng = np.random.default_rng(3)
    law = np.tanh(3 * INPUT)
    u = law + rng.normal(0, law.std(), TIME.size)
    other = np.sin(2 * np.pi * 3.1 * TIME)
    first, second = residual_maps([u], {"other": [other], "command": [INPUT]})
    assert (first.variable, second.variable) == ("command", "other")
    assert first.explained == pytest.approx(0.5, abs=0.08)
    assert second.explained < 0.05
    inside = np.abs(first.mean - np.tanh(3 * first.x)) < np.maximum(2 * first.half_width, 0.3)
    assert np.mean(inside) > 0.8


def explaining(variable: str, share: float) -> ResidualMap:
    """A map that explains this share of the squared residual."""
    ends = np.array([-1.0, 1.0])
    return ResidualMap(variable, ends, ends, ends * 0.1, share, 0.0, 100.0)


@pytest.mark.parametrize(
    ("plain", "rubs", "depends_on"),
    [
        (0.22, 0.27, ("theta_2", "omega_2")),
        (0.5, 0.55, ("torque",)),
        (0.3, 0.5, ("theta_2", "omega_2")),
        (0.2, 0.2, ()),
    ],
)
def test_a_friction_is_described_where_it_explains_more(plain: float, rubs: float, depends_on: tuple[str, ...]) -> None:
    """A dry friction that depends on the angle is taken where it explains clearly more than a state, or where that
    explains too little to be named; nothing that explains less than a quarter is named."""
    found = finding("joint", "a torque", "N m", [explaining("torque", plain)], [explaining("theta_2", rubs)], "omega_2")
    assert found.depends_on == depends_on
