"""Scores freed of what they owe to motion and temperature."""

from __future__ import annotations

import numpy as np
import pytest

from lostmotion.detector.normalise import normalised
from lostmotion.detector.trend import summarise

COUNT, DAY = 600, 86400.0


def history(seed: int, wear: float, exponent: float = 0.6, warmth: float = 0.02) -> tuple[np.ndarray, ...]:
    """A year of times [s], scores, excitations [rad/s²] and temperatures [°C]: the arm gets a job twice as hard after
    half of it, the gearbox is warm in summer and in the afternoon; wear: growth in the year."""
    rng = np.random.default_rng(seed)
    time = np.linspace(0, 365 * DAY, COUNT)
    share = time / time[-1]
    excitation = np.where(share < 0.5, 10.0, 20.0) * np.exp(rng.normal(0, 0.3, COUNT))
    temperature = 35 + 8 * np.sin(2 * np.pi * share) + rng.normal(0, 4, COUNT)
    log = wear * share + exponent * np.log(excitation) + warmth * (temperature - 35) + rng.normal(0, 0.15, COUNT)
    return time, np.exp(log), excitation, temperature


def freed(score: np.ndarray, excitation: np.ndarray, temperature: np.ndarray) -> tuple[np.ndarray, dict[str, float]]:
    """Normalised by both."""
    return normalised(score, {"excitation": np.log(excitation), "temperature": temperature})


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_new_job_and_a_summer_are_no_wear(seed: int) -> None:
    """Without wear the raw scores rise and change; freed, they have no trend and no change, and both laws are found."""
    time, score, excitation, temperature = history(seed, 0.0)
    assert summarise(time, score, 100.0).trend.p_value < 1e-6
    assert len(summarise(time, score, 100.0).change_points) >= 1
    result, laws = freed(score, excitation, temperature)
    assert laws["excitation"] == pytest.approx(0.6, abs=0.08)
    assert laws["temperature"] == pytest.approx(0.02, abs=0.006)
    wear = summarise(time, result, 100.0)
    assert wear.trend.p_value > 0.001
    assert abs(wear.slope.slope) * time[-1] < 0.1 * np.median(result)
    assert wear.change_points == ()


@pytest.mark.parametrize("seed", [4, 5, 6])
def test_wear_stays(seed: int) -> None:
    """Wear of a factor 2 in the year is found within 15 % though the job became half as hard meanwhile."""
    _, score, excitation, temperature = history(seed, np.log(2), exponent=-0.6)
    result, _ = freed(score, excitation, temperature)
    early, late = np.median(result[:60]), np.median(result[-60:])
    assert late / early == pytest.approx(2**0.9, rel=0.15)


def test_what_depends_on_nothing_is_left_alone() -> None:
    """Of fifty series without any dependence none is touched; neither is one whose quantities are unknown."""
    for seed in range(50):
        _, score, excitation, temperature = history(seed, 0.5, exponent=0.0, warmth=0.0)
        result, laws = freed(score, excitation, temperature)
        assert laws == {}
        assert result is score
    assert normalised(score, {"temperature": np.full(COUNT, np.inf)}) == (score, {})


def test_outliers_do_not_matter() -> None:
    """One score in twenty a hundred times too large moves the exponent by less than 0.1."""
    _, score, excitation, temperature = history(7, 0.3)
    score[::20] *= 100
    assert freed(score, excitation, temperature)[1]["excitation"] == pytest.approx(0.6, abs=0.1)


def test_few_points_tell_nothing() -> None:
    """Nineteen points are no evidence of any dependence."""
    _, score, excitation, temperature = (column[:19] for column in history(8, 0.0))
    assert freed(score, excitation, temperature) == (score, {})
