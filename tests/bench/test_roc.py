"""The measurements of the detector's bench are right."""

from __future__ import annotations

import numpy as np
import pytest
from bench.roc.bounds import likelihoods
from bench.roc.needed import needed
from bench.roc.noises import KINDS, covariance, draw
from bench.roc.rivals import RIVALS, Known, crest, kurtosis, peak, rms
from bench.roc.waveforms import Bar, windows_of


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
    """A library of the true waveform h alone: s y·h - s²/2, for y = noise and for y = noise + s h; of two, the mean."""
    shape, noise, sizes = np.full((1, 4), 0.5), np.array([[1.0, 2, 3, 4]]), np.array([2.0, 3.0])
    assert likelihoods(noise, None, shape, sizes)[:, 0] == pytest.approx([2 * 5 - 2, 3 * 5 - 4.5])
    assert likelihoods(noise, shape, shape, sizes)[:, 0] == pytest.approx([2 * 7 - 2, 3 * 8 - 4.5])
    both = np.array([shape[0], -shape[0]])
    assert likelihoods(noise, None, both, sizes[:1])[0, 0] == pytest.approx(np.log((np.exp(8) + np.exp(-12)) / 2))


def test_bounds_hold_the_best_between_them() -> None:
    """One of 200 orthogonal waveforms, all equally likely: who knows them needs as much as a direct count says, who
    knows 200 others finds nothing."""
    rng, sizes = np.random.default_rng(8502), 10 ** (np.arange(10.0, 19.0) / 20)
    waves, which = np.eye(400), rng.integers(200, size=2000)
    quiet, loud = rng.normal(size=(2, 2000, 400))
    healthy = likelihoods(quiet, None, waves[:200], sizes)
    same, fresh = (likelihoods(loud, waves[which + shift], waves[:200], sizes) for shift in (0, 200))
    motion = np.arange(2000) % 10
    inside = needed(healthy, same, 20 * np.log10(sizes), motion)
    by_hand = [np.log(np.mean(np.exp(s * y[:, :200] - s**2 / 2), axis=1))
               for y, s in ((quiet, sizes[5]), (loud + sizes[5] * waves[which], sizes[5]))]  # fmt: skip
    share = np.mean(by_hand[1] > np.quantile(by_hand[0], 0.99))
    assert np.mean(same[5] > np.quantile(healthy[5], 0.99)) == pytest.approx(share, abs=2e-3)
    assert inside.db == pytest.approx(13.5, abs=1.0)
    assert 0 < inside.error < 0.3
    assert np.isnan(needed(healthy, fresh, 20 * np.log10(sizes), motion).db)


def test_needed_by_hand() -> None:
    """Normal scores of unit variance need 2.326 + 1.282, 11.1 dB; the error is that of other draws."""
    rng, db = np.random.default_rng(8503), np.arange(8.0, 16.0)
    told = []
    for _ in range(40):
        healthy, worn = rng.normal(size=2000), 10 ** (db[:, None] / 20) + rng.normal(size=(8, 2000))
        told.append(needed(healthy, worn, db, np.arange(2000) % 20))
    assert np.mean([one.db for one in told]) == pytest.approx(11.15, abs=0.06)
    assert np.mean([one.error for one in told]) == pytest.approx(np.std([one.db for one in told]), rel=0.3)


@pytest.mark.parametrize("name", RIVALS)
def test_every_rival_tells_a_loud_ring_from_noise(name: str) -> None:
    """A ring-down of 30 dB in white noise on a slow motion scores above nearly all noise, but by those that look at the
    shape alone: it rings through most of the window, and a bar's line is no spike."""
    rng, time = np.random.default_rng(8504), np.arange(250) / 1000
    since = np.maximum(time - 0.06, 0.0)
    ring = np.where(time > 0.06, np.exp(-0.012 * 364 * since) * np.sin(364.4 * since), 0.0)
    quiet, loud, old, loud_old = rng.normal(size=(4, 300, 250)) + 10 * np.sin(2 * np.pi * 2 * time)
    size = 10**1.5 / np.linalg.norm(ring)
    of = RIVALS[name](Known(1000.0, 58.0, 0.012, 0.25, old, loud_old + size * ring))
    worn, healthy = of(loud + size * ring), of(quiet)
    assert np.isfinite([worn, healthy]).all()
    if "kurt" not in name and name != "crest factor":
        assert np.mean(worn > np.quantile(healthy, 0.99)) > 0.99


def test_both_simulators_agree_without_play() -> None:
    """With a play of a hundredth of a micrometre both tips move as if there were none, to 3 % of the motion."""
    for mujoco in (False, True):
        windows = windows_of(8501, 1e-8 if mujoco else 1e-7, Bar(), 0.25, mujoco)
        if mujoco:
            left = np.sqrt(np.mean((windows.worn - windows.healthy) ** 2))
            assert left < 0.03 * np.sqrt(np.mean(windows.healthy**2))
        assert windows.worn.shape == windows.healthy.shape
        assert len(windows.worn) > 20
