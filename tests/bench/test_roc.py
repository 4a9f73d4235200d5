"""The bench of the detector measures what it says."""

from __future__ import annotations

import numpy as np
import pytest
from bench.roc.noises import KINDS, covariance, draw
from bench.roc.rivals import average_likelihood, crest, kurtosis, peak, rms
from bench.roc.waveforms import Bar, from_model, from_mujoco
from bench.table1 import wilson


@pytest.mark.parametrize("kind", KINDS)
def test_covariance_is_that_of_the_noise(kind: str) -> None:
    """Noise that is whitened by the covariance has unit variance, within 5 %, for fresh windows."""
    root = np.linalg.cholesky(covariance(kind, 50, 200.0, 58.0))
    white = np.linalg.solve(root, draw(np.random.default_rng(8500), kind, 4000, 50, 200.0, 58.0).T)
    assert np.mean(white**2) == pytest.approx(1.0, abs=0.05)


def test_classics_by_hand() -> None:
    """Of a sine: peak 1, root mean square 1/√2, kurtosis 1.5, crest factor √2."""
    wave = np.sin(2 * np.pi * np.arange(1000) / 100)[None]
    told = [float(of(wave)[0]) for of in (peak, rms, kurtosis, crest)]
    assert told == pytest.approx([1.0, 0.5**0.5, 1.5, 2**0.5], rel=1e-3)


def test_one_waveform_gives_the_likelihood_ratio() -> None:
    """A library of the true waveform alone: s y - s²/2."""
    shape = np.full((1, 4), 0.5)
    assert average_likelihood(np.array([[1.0, 2, 3, 4]]), shape, 2.0)[0] == pytest.approx(2 * 5 - 2)


def test_both_simulators_agree_without_play() -> None:
    """With a play of a hundredth of a micrometre both tips move as if there were none, to 3 % of the motion."""
    for make in (from_model, from_mujoco):
        windows = make(8501, 1e-7 if make is from_model else 1e-8, Bar(), 0.25)
        if make is from_mujoco:
            left = np.sqrt(np.mean((windows.worn - windows.healthy) ** 2))
            assert left < 0.03 * np.sqrt(np.mean(windows.healthy**2))
        assert windows.worn.shape == windows.healthy.shape
        assert len(windows.worn) > 20


def test_wilson_by_hand() -> None:
    """98 of 100: 93.00 to 99.45 %."""
    assert wilson(98, 100) == " 98.00 (93.00 to 99.45)"
