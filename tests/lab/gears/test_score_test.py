"""The score test on straight lines: its false alarms where nothing is missing, and the faint effects that it finds."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.stats import binom

from lostmotion.lab.data.experiment import experiments
from lostmotion.lab.gears.score_test import Scores, score_test
from lostmotion.lab.shooting.continuation import Level, fitted, tiles
from lostmotion.lab.shooting.initial_state import segment_of
from lostmotion.lab.shooting.parameters import Unknowns
from lostmotion.model import build_model
from lostmotion.model.motion import FloatArray
from tests.lab.simulated_gears import GEARS, Moved, moved

NOISE = 0.3
SUBSTEP = 1e-4
CASES = 48
EFFECTS = ("coulomb_friction", "viscous_friction", "hardening_spring", "gravity_leakage", "bias_drift")
FEW = ("coulomb_friction", "hardening_spring", "bias_drift")
POOL = ThreadPoolExecutor(2)


@cache
def clean(hidden: tuple[tuple[str, float], ...]) -> Moved:
    """One motion, with something hidden."""
    return moved(8, **dict(hidden))


def noise_like(rng: np.random.Generator, size: int, correlation: float) -> FloatArray:
    """Gaussian, of one rms; each sample resembles the one before."""
    white = rng.normal(size=size + 200)
    return np.asarray(NOISE * lfilter([np.sqrt(1 - correlation**2)], [1, -correlation], white)[200:])


def level_of(seed: int, correlation: float, hidden: dict[str, float]) -> Level:
    """The base play, fitted to gears with a hidden effect, on segments that begin near their true states."""
    run = clean(tuple(hidden.items()))
    reading = run.accel + noise_like(np.random.default_rng(seed), run.time.size, correlation)
    model = build_model("play", values=GEARS)
    (experiment,) = experiments(model, [run.recording(reading)])
    segments = [
        segment_of(model, tile, {"accel": NOISE}).starting(run.states[np.searchsorted(run.time, tile.time[0]), :4])
        for tile in tiles(experiment, 3)
    ]
    return fitted(model, Unknowns.of(model), segments, SUBSTEP)


def scored(level: Level, seed: int = 0, effects: Sequence[str] = EFFECTS) -> Scores:
    """Some effects of the catalogue."""
    return score_test(level, effects, SUBSTEP, POOL, np.random.default_rng(seed))


@cache
def nothing_missing() -> Level:
    """A fit that leaves white noise."""
    return level_of(0, 0.0, {})


def with_noise(seed: int, correlation: float) -> Level:
    """The same model on its own motion with new noise."""
    rng, level = np.random.default_rng((seed, 77)), nothing_missing()
    segments = []
    for segment in level.segments[:3]:
        modelled = segment.simulate(level.model, segment.start, SUBSTEP)["accel"]
        accel = modelled + noise_like(rng, modelled.size, correlation)
        segments.append(replace(segment, experiment=replace(segment.experiment, measured={"accel": accel})))
    return replace(level, segments=tuple(segments))


def p_value(scores: Scores) -> float:
    """Of the largest statistic, in the whole search."""
    return float(np.mean(scores.null >= scores.directions[0].statistic))


@pytest.mark.slow
@pytest.mark.parametrize("correlation", [0.0, 0.7], ids=["white", "coloured"])
def test_false_alarms(correlation: float) -> None:
    """Where nothing is missing the whole search alarms in 5 % of cases, within the bounds of the binomial."""
    found = [scored(with_noise(seed, correlation), seed, FEW) for seed in range(CASES)]
    alarms = sum(scores.directions[0].statistic > scores.limit for scores in found)
    assert binom.ppf(0.001, CASES, 0.05) <= alarms <= binom.ppf(0.999, CASES, 0.05)
    smallest = np.array([p_value(scores) for scores in found])
    assert np.mean(smallest < 0.5) == pytest.approx(0.5, abs=0.17)


FAINT = {
    "coulomb_friction": {"coulomb_friction.tau_c": 1.5e-5, "coulomb_friction.omega_0": 1e-2},
    "hardening_spring": {"hardening_spring.k3": 2e10},
    "gravity_leakage": {"gravity_leakage.c": 0.05, "gravity_leakage.phi": 0.3},
}


@pytest.mark.slow
@pytest.mark.parametrize("effect", FAINT)
@pytest.mark.parametrize("correlation", [0.0, 0.5], ids=["white", "coloured"])
def test_faint_effect_is_found(effect: str, correlation: float) -> None:
    """An effect that raises the error by a few per cent only is first, beyond doubt."""
    level = level_of(1, correlation, FAINT[effect])
    assert level.typical < 1.3 * nothing_missing().typical
    scores = scored(level)
    assert scores.directions[0].effect == effect
    assert scores.directions[0].statistic > scores.limit
    assert p_value(scores) < 0.01


def test_amplitude_is_of_the_right_size() -> None:
    """The sensor's leak is linear: the test asks for about as much as was hidden, from its faint beginning."""
    level = level_of(1, 0.0, FAINT["gravity_leakage"])
    best = scored(level).directions[0]
    c = best.model.parameters["gravity_leakage.c"].value * best.amplitude
    assert abs(c) == pytest.approx(0.05, rel=0.5)


def test_scores_are_told_for_all() -> None:
    """Best first, each effect once; equal seeds, equal tests."""
    scores = scored(nothing_missing(), 4)
    effects = [direction.effect for direction in scores.directions]
    assert sorted(effects) == sorted(EFFECTS)
    statistics = [direction.statistic for direction in scores.directions]
    assert statistics == sorted(statistics, reverse=True)
    assert scored(nothing_missing(), 4).limit == scores.limit
