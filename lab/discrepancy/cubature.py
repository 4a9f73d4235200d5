"""A cubature Kalman filter and smoother along a recording, with one unknown input and one coloured noise; compiled.

Arasaratnam and Haykin 2009: "Cubature Kalman filters".  input_estimation.py defines the input and the meaning of the
numbers.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar, cast

import numpy as np
from numba import njit

from lostmotion.model.kernel import compiled
from lostmotion.model.motion import FloatArray
from lostmotion.model.solve import integrate

__all__ = ["Path", "run_filter"]

F = TypeVar("F", bound=Callable[..., Any])
MOST_CHANGE, WIDEST = 6.0, 0.5
"""Largest change of a state in one sample, and its largest standard deviation, as shares of its scale."""
UNSURE = 0.3
"""Standard deviation of the start state, as a share of its scale."""
FAR = 5.0
"""Standard deviations beyond which a sample gets a smaller weight."""


def _part(function: F) -> F:
    """Decorator: a function that the filter calls; inlined by force, it would take twice as long to compile."""
    return cast(F, njit(error_model="numpy")(function))


class Path(NamedTuple):
    """The arguments of the filter: the solver's tables and input from the first sample on (see ``solve.integrate``).

    at: the index of u among the parameters, negative where it acts on the sensor; scale: (m,) units of the augmented
    state: n states, u, and e, the coloured noise of the first column; keeps: (2,) autoregressive coefficients of u and
    e; noise: (m,) variance of the process noise.
    """

    plan: Any
    at: int
    knots: FloatArray
    coefficients: FloatArray
    substep: float
    records: Any
    origin: float
    scale: FloatArray
    keeps: FloatArray
    noise: FloatArray


@_part
def _points(mean: FloatArray, cov: FloatArray) -> FloatArray:
    """The cubature points (2 m, m) of a normal distribution."""
    m = mean.size
    factor = np.sqrt(m) * np.linalg.cholesky(cov)
    points = np.empty((2 * m, m))
    for i in range(m):
        points[i] = mean + factor[:, i]
        points[m + i] = mean - factor[:, i]
    return points


@_part
def _run(path: Path, points: FloatArray, k0: int, k1: int) -> tuple[FloatArray, FloatArray]:
    """The model's states (2 m, n) and outputs (2 m, columns) at one knot, from these points at another one."""
    n = path.scale.size - 2
    ends, outputs = np.empty((len(points), n)), np.empty((len(points), path.records.size))
    out, states = np.empty((path.records.size, 1)), np.empty((1, n))
    for i in range(len(points)):
        if path.at >= 0:
            path.plan.p[path.at] = points[i, n] * path.scale[n]
        integrate(path.plan, path.knots[k0 : k1 + 1], path.coefficients[k0 : k1 + 1], path.substep,
                  points[i, :n] * path.scale[:n], path.knots[k1 : k1 + 1], path.records, out, states,
                  path.origin)  # fmt: skip
        ends[i], outputs[i] = states[0] / path.scale[:n], out[:, 0]
    return ends, outputs


@_part
def _predicted(
    path: Path, mean: FloatArray, cov: FloatArray, k0: int, k1: int
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Mean (m,) and covariance (m, m) one sample later, and the covariance of then and now."""
    m, n = mean.size, mean.size - 2
    points, moved = _points(mean, cov), np.empty((2 * mean.size, mean.size))
    moved[:, :n] = _run(path, points, k0, k1)[0]
    moved[:, n], moved[:, n + 1] = path.keeps[0] * points[:, n], path.keeps[1] * points[:, n + 1]
    for i in range(2 * m):
        for j in range(n):  # deep in the contact a point diverges, and would spoil the mean
            if not abs(moved[i, j] - mean[j]) < MOST_CHANGE:
                moved[i, j] = mean[j] + (MOST_CHANGE if moved[i, j] > mean[j] else -MOST_CHANGE)
    new = np.ones(2 * m) @ moved / (2 * m)
    cross = (points - mean).T @ (moved - new) / (2 * m)
    spread = (moved - new).T @ (moved - new) / (2 * m)
    for i in range(m):
        spread[i, i] += path.noise[i]
    for i in range(n):
        if spread[i, i] > WIDEST**2:
            share = WIDEST / np.sqrt(spread[i, i])
            spread[i] *= share
            spread[:, i] *= share
            cross[:, i] *= share
    return new, spread, cross


@_part
def _corrected(
    path: Path, mean: FloatArray, cov: FloatArray, k: int, column: int, value: float, variance: float
) -> tuple[FloatArray, FloatArray, float]:
    """Mean and covariance given a value of a column at this knot, and its log-likelihood."""
    m, n = mean.size, mean.size - 2
    points = _points(mean, cov)
    outputs = _run(path, points, k, k)[1][:, column].copy()
    if column == 0:
        outputs += points[:, n + 1] * path.scale[n + 1]
        if path.at < 0:
            outputs += points[:, n] * path.scale[n]
    expected = outputs.mean()
    off = outputs - expected
    s = variance + off @ off / (2 * m)
    gain = (points - mean).T @ off / (2 * m)
    error = value - expected
    square = error * error / s
    score = -0.5 * (np.log(s) + square)
    if square > FAR * FAR:  # Huber's cost, and his weight
        score = -0.5 * (np.log(s) + FAR * (2 * np.sqrt(square) - FAR))
        s *= np.sqrt(square) / FAR
    cov = cov - np.outer(gain, gain) / s
    return mean + gain * (error / s), 0.5 * (cov + cov.T), score


def _run_filter(
    path: Path, times: FloatArray, y: FloatArray, variance: FloatArray, start: FloatArray, smooth: bool
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Log-likelihoods (N,), means (N, m), deviations of u (N,); y: (N, columns), NaN where not sampled; variance:
    (columns,) of their white noise; start: (m,).  Works in units of ``path.scale``.
    """
    m, n, samples = path.scale.size, path.scale.size - 2, times.size
    mean, cov = start / path.scale, np.eye(m)
    for i in range(n):
        cov[i, i] = UNSURE**2
    scores, means, covs = np.zeros(samples), np.empty((samples, m)), np.empty((samples, m, m))
    before, spreads, crosses = np.empty((samples, m)), np.empty((samples, m, m)), np.empty((samples, m, m))
    k0 = 0
    for sample in range(samples):
        k1 = k0
        while k1 < path.knots.size - 1 and path.knots[k1] < times[sample] - 1e-9:
            k1 += 1
        if sample > 0:
            mean, cov, crosses[sample] = _predicted(path, mean, cov, k0, k1)
        before[sample], spreads[sample] = mean, cov
        for column in range(path.records.size):
            if not np.isnan(y[sample, column]):
                mean, cov, score = _corrected(path, mean, cov, k1, column, y[sample, column], variance[column])
                scores[sample] += score
        means[sample], covs[sample] = mean, cov
        k0 = k1
    for sample in range(samples - 2, -1 if smooth else samples, -1):  # Rauch, Tung and Striebel's smoother
        back = np.linalg.solve(spreads[sample + 1], crosses[sample + 1].T).T
        means[sample] += back @ (means[sample + 1] - before[sample + 1])
        covs[sample] += back @ (covs[sample + 1] - spreads[sample + 1]) @ back.T
    return scores, means * path.scale, np.sqrt(np.maximum(covs[:, n, n], 0.0)) * path.scale[n]


run_filter = compiled(lambda **options: njit(nogil=True, error_model="numpy", **options)(_run_filter))
