"""Autoregressive noise: found, and undone."""

from __future__ import annotations

import numpy as np
import pytest

from lostmotion.detector.errors import DetectorError
from lostmotion.detector.whitening import Noise, fit_noise, rounded, spectrum, unwhitener, whiten, whitener

SLOW = np.linalg.qr(np.polynomial.legendre.legvander(np.linspace(-1, 1, 250), 8))[0]


def coloured(rng: np.random.Generator, count: int, length: int) -> np.ndarray:
    """Stationary second-order noise, x = 1.2 x1 - 0.8 x2 + e: a spectrum with a peak."""
    out = rng.normal(size=(count, length + 200))
    for i in range(2, length + 200):
        out[:, i] += 1.2 * out[:, i - 1] - 0.8 * out[:, i - 2]
    return out[:, 200:]


def test_coefficients_of_a_known_process() -> None:
    """x = 1.2 x1 - 0.8 x2 + e has the reflections -1.2/1.8 and 0.8, and hardly more."""
    found = fit_noise(coloured(np.random.default_rng(7900), 200, 250), SLOW)
    assert found.colour[:2] == pytest.approx((-1.2 / 1.8, 0.8), abs=0.02)
    assert np.abs(found.colour[2:]).max(initial=0.0) < 0.02
    assert found.deviation == pytest.approx(1.0, rel=0.02)


@pytest.mark.slow
def test_white_noise_has_no_colour() -> None:
    """White noise is not predicted, also when a motion a thousand times as large is in the windows."""
    rng = np.random.default_rng(7901)
    found = fit_noise(rng.normal(size=(200, 250)) + 1000 * rng.normal(size=(200, 9)) @ SLOW.T, SLOW)
    assert found.colour == ()
    assert found.deviation == pytest.approx(1.0, rel=0.01)


def test_whitened_noise_is_white_from_the_first_sample_on() -> None:
    """Unit variance at every place, no correlation at any lag: within five standard errors."""
    white = whiten(coloured(np.random.default_rng(7902), 4000, 40), (-1.2 / 1.8, 0.8))
    covariance = white.T @ white / len(white)
    assert np.abs(covariance - np.eye(40)).max() < 5 * np.sqrt(2 / 4000)


@pytest.mark.parametrize(("length", "order"), [(250, 0), (250, 7), (250, 64), (40, 39), (40, 60)])
def test_what_is_whitened_is_undone(length: int, order: int) -> None:
    """The inverse by the filter's impulse response is the matrix's inverse, also where the filter is longer than it."""
    colour = tuple(np.random.default_rng(order).uniform(-0.5, 0.5, order))
    found = unwhitener(length, colour) @ whitener(length, colour)
    assert np.abs(found - np.eye(length)).max() < 1e-9


def test_no_colour_changes_nothing() -> None:
    """Without reflections what comes out is what went in."""
    values = np.random.default_rng(7903).normal(size=(3, 20))
    assert np.array_equal(whiten(values, ()), values)


def test_too_little_is_an_error() -> None:
    """Windows of fewer than 16 samples, or with holes, are refused."""
    for windows in (np.zeros((5, 12)), np.full((5, 200), np.nan)):
        with pytest.raises(DetectorError, match="at least 16 samples"):
            fit_noise(windows, SLOW[: windows.shape[1]])


@pytest.mark.parametrize("colour", [(), (0.5,), (-1.2 / 1.8, 0.8), tuple(np.linspace(-0.3, 0.3, 9))])
@pytest.mark.parametrize("length", [1, 6, 40])
def test_whitening_is_a_matrix(colour: tuple[float, ...], length: int) -> None:
    """``whitener`` times a window is the whitened window, also where it is shorter than the filter."""
    window = np.random.default_rng(7910).normal(size=length)
    assert whitener(length, colour) @ window == pytest.approx(whiten(window, colour), abs=1e-12)


def test_whitening_does_not_depend_on_the_order_in_memory() -> None:
    """Windows that lie column by column are whitened alike."""
    windows = np.random.default_rng(7911).normal(size=(3, 2, 40))
    across = np.transpose(np.ascontiguousarray(np.transpose(windows, (2, 0, 1))), (1, 2, 0))
    assert np.array_equal(whiten(across, (0.5,)), whiten(windows, (0.5,)))


@pytest.mark.parametrize("close", [0.99996, -0.999999, 0.999999999999, -(1 - 2.0**-53)])
def test_few_digits_keep_a_process_stable(close: float) -> None:
    """A line is a reflection close to ±1, which no rounding may make ±1: the peak keeps its power within 0.2 %; others
    have four decimals."""
    noise = Noise(0.123456, (0.612345, close))
    found = rounded(noise)
    assert (found.deviation, found.colour[0]) == (0.1235, 0.6123)
    assert abs(found.colour[1]) < 1
    assert 1 - abs(found.colour[1]) == pytest.approx(1 - abs(close), rel=1e-3)
    exact = Noise(noise.deviation, (0.6123, close))
    alike = Noise(noise.deviation, found.colour)
    if abs(close) < 0.9999999:
        assert spectrum(alike, 4096).sum() == pytest.approx(spectrum(exact, 4096).sum(), rel=2e-3)
