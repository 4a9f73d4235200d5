"""Changes of level and slope: found where they are, and none where there are none."""

from __future__ import annotations

import numpy as np
import pytest

from lostmotion.detector.changes import change_points
from tests.detector.test_trend import autocorrelated


def test_a_jump_and_a_bend_are_found() -> None:
    """A level that jumps at 60, and a slope that sets in at 120 of 200."""
    rng = np.random.default_rng(50)
    index = np.arange(200)
    jump, bend = change_points(np.where(index < 60, 0, 5) + 0.2 * np.maximum(index - 120, 0) + rng.normal(size=200))
    assert jump == pytest.approx(60, abs=2)
    assert bend == pytest.approx(120, abs=10)


@pytest.mark.parametrize("count", [30, 100, 500])
@pytest.mark.parametrize("kind", ["normal", "heavy", "skewed", "correlated"])
def test_noise_has_no_changes(count: int, kind: str) -> None:
    """At least 95 % of series without any change give none, whatever the noise."""
    rng = np.random.default_rng(51)
    runs = 100 if count < 500 else 20

    def series() -> np.ndarray:
        if kind == "normal":
            return rng.normal(size=count)
        if kind == "heavy":
            return rng.standard_t(3, count)
        return rng.exponential(size=count) if kind == "skewed" else autocorrelated(rng, count, 0.3)

    assert np.mean([change_points(series()) == [] for _ in range(runs)]) >= 0.95


def test_a_slope_is_no_change() -> None:
    """Steady wear is one line."""
    assert change_points(0.1 * np.arange(300) + np.random.default_rng(52).normal(size=300)) == []


def test_long_series_and_nan() -> None:
    """100,000 points with holes: the jump's place among all points, to a run of 200."""
    rng = np.random.default_rng(53)
    series = rng.normal(size=100_000)
    series[70_000:] += 3
    series[::7] = np.nan
    (found,) = change_points(series)
    assert found == pytest.approx(70_000, abs=250)


@pytest.mark.parametrize("series", [[], [1.0, 2.0], [5.0] * 100, [float("nan")] * 50])
def test_too_little_is_no_change(series: list[float]) -> None:
    """Few points, one value for ever, or none at all."""
    assert change_points(series) == []
