"""Convergence by halving, and the horizon beyond which samples mean nothing."""

from __future__ import annotations

import math
import warnings

import numpy as np
import pytest

from lostmotion.model import (
    ChaoticMotionWarning,
    HandWaved,
    Parameter,
    Sine,
    build_model,
    check,
    predictability_horizon,
)

TIMES = np.arange(2001) * 1e-3


@pytest.mark.parametrize("motion", [Sine(6.0, 0.02), HandWaved(seed=0), HandWaved(seed=2)])
def test_weak_contact_damping_is_chaotic(motion: Sine | HandWaved) -> None:
    """At alpha = 500 a change of 1e-6 has changed everything within 2 s, and the check warns."""
    with pytest.warns(ChaoticMotionWarning, match="chaotic"):
        found = check(build_model("play", (), {"alpha": 500.0}), motion, TIMES)
    assert 0.3 < found.horizon_s < 2.0


@pytest.mark.parametrize("motion", [Sine(6.0, 0.02), HandWaved(seed=0), HandWaved(seed=2)])
@pytest.mark.parametrize("alpha", [3000.0, 4000.0])
def test_strong_contact_damping_is_predictable(motion: Sine | HandWaved, alpha: float) -> None:
    """From alpha = 3000 the whole record can be predicted, and the chosen step is converged to 1e-3."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = check(build_model("play", (), {"alpha": alpha}), motion, TIMES)
    assert found.horizon_s == math.inf
    assert found.error < 1e-3


def test_whole_numbers_are_left_as_they_are() -> None:
    """A model whose contact exponent and periods a turn are free has a horizon, though 11.00001 is no exponent."""
    free = {"alpha": 500.0, "n": Parameter(11.0), "gear_eccentricity.N": Parameter(12.0)}
    model = build_model("play", ["gear_eccentricity"], free)
    assert not any(model.parameters[name].fixed for name in free)
    assert 0.3 < predictability_horizon(model, Sine(6.0, 0.02), TIMES) < 2.0


def test_bases_without_contact_are_predictable() -> None:
    """A ring-down has no horizon."""
    model = build_model("oscillator")
    assert predictability_horizon(model, None, TIMES, model.initial_state(q=1e-3)) == math.inf
