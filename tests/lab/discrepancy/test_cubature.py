"""The cubature filter and smoother against a Kalman filter and least squares written out in numpy."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm

from lostmotion.lab.data.autoregression import NoiseModel
from lostmotion.lab.data.experiment import Experiment
from lostmotion.lab.discrepancy.cubature import UNSURE
from lostmotion.lab.discrepancy.input_estimation import InputProcess, Tracker
from lostmotion.model import build_model
from lostmotion.model.motion import FloatArray

RATE_HZ, COUNT = 1000.0, 300
M, K = 0.5, 0.5 * (2 * np.pi * 8) ** 2
B = 0.04 * np.sqrt(K * M)
SCALE = np.array([2e-3, 0.1])
NOISE, SIZE, MEMORY_S, FLOOR = 1e-4, 0.8, 0.05, 1e-3


def tracker(measured: FloatArray) -> Tracker:
    """An oscillator at rest whose displacement [m] was measured at 1 kHz."""
    model = build_model("oscillator", values={"m": M, "k": K, "b": B})
    experiment = Experiment("made", None, np.arange(measured.size) / RATE_HZ, {"displacement": measured})
    return Tracker(model, experiment, {"displacement": NoiseModel.white(NOISE)}, SCALE, np.zeros(2))


def recorded(seed: int) -> tuple[FloatArray, FloatArray]:
    """Displacement with noise (N,) [m] under a force (N,) [N] that is an Ornstein-Uhlenbeck process, held for each
    sample: exact by the matrix exponential."""
    rng = np.random.default_rng(seed)
    keeps = np.exp(-1 / RATE_HZ / MEMORY_S)
    forces, state, states = np.zeros(COUNT), np.zeros(2), np.zeros((COUNT, 2))
    for i in range(1, COUNT):
        state = transition() @ np.append(state, forces[i - 1])
        states[i] = state
        forces[i] = keeps * forces[i - 1] + SIZE * np.sqrt(1 - keeps**2) * rng.normal()
    return states[:, 0] + rng.normal(0, NOISE, COUNT), forces


def transition() -> FloatArray:
    """(2, 3): displacement and speed after a sample from displacement, speed and force."""
    a = np.array([[0, 1, 0], [-K / M, -B / M, 1 / M], [0, 0, 0]])
    return np.asarray(expm(a / RATE_HZ)[:2])


def smoothed(measured: FloatArray) -> tuple[float, FloatArray]:
    """Log-likelihood after 0.1 s, and the smoothed force (N,), by Kalman's filter and by least squares over all
    samples at once (another way to the same mean)."""
    keeps = np.exp(-1 / RATE_HZ / MEMORY_S)
    step = np.vstack([transition(), [0, 0, keeps]])
    process = np.diag(np.append((FLOOR * SCALE) ** 2, SIZE**2 * (1 - keeps**2)))
    first = np.diag(np.append((UNSURE * SCALE) ** 2, SIZE**2))
    mean, cov, scores = np.zeros(3), first, np.zeros(COUNT)
    for i in range(COUNT):
        if i:
            mean, cov = step @ mean, step @ cov @ step.T + process
        s = cov[0, 0] + NOISE**2 * (1 + 1e-6)
        error = measured[i] - mean[0]
        scores[i] = -0.5 * (np.log(s) + error**2 / s)
        mean, cov = mean + cov[:, 0] * error / s, cov - np.outer(cov[:, 0], cov[0]) / s
    rows = [np.linalg.cholesky(np.linalg.inv(first)).T @ np.eye(3, 3 * COUNT)]
    weight = np.linalg.cholesky(np.linalg.inv(process)).T
    blocks = range(3, 3 * COUNT, 3)
    rows += [weight @ (np.eye(3, 3 * COUNT, i) - step @ np.eye(3, 3 * COUNT, i - 3)) for i in blocks]
    looks = np.zeros((COUNT, 3 * COUNT))
    looks[np.arange(COUNT), 3 * np.arange(COUNT)] = 1 / NOISE
    left = np.concatenate([np.zeros(3 * COUNT), measured / NOISE])
    best = np.linalg.lstsq(np.vstack([*rows, looks]), left, rcond=None)[0]
    return float(scores[np.arange(COUNT) / RATE_HZ >= 0.1].sum()), best[2::3]


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_linear_system_is_filtered_and_smoothed_as_kalman_does(seed: int) -> None:
    """On an oscillator the cubature rule is exact: likelihood and smoothed force are those of linear theory, and the
    force is followed to a fifth of its size."""
    measured, forces = recorded(seed)
    track = tracker(measured).run(InputProcess("oscillator", SIZE, MEMORY_S, FLOOR), smooth=True)
    likelihood, force = smoothed(measured)
    assert track.log_likelihood == pytest.approx(likelihood, abs=0.05 * abs(likelihood) / 100)
    assert np.abs(track.u - force).max() < 0.02 * SIZE
    inner = slice(30, -30)
    off = track.u[inner] - forces[inner]
    assert np.std(off) < 0.5 * np.std(forces)
    assert 0.5 < np.std(off / track.deviation[inner]) < 1.5


def test_a_filter_that_diverges_has_no_likelihood() -> None:
    """A covariance that is not positive definite makes NaN, which no equation is chosen by."""
    measured, _ = recorded(1)
    measured[150:] = np.inf
    track = tracker(measured).run(InputProcess("oscillator", SIZE, MEMORY_S, FLOOR))
    assert not np.isfinite(track.log_likelihood)
