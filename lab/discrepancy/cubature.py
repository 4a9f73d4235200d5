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
    """Decorator: a function that the filter calls; inlined by force, it would take twice as long to compile.

    Sums are loops: with numpy's expressions and linear algebra it would take several times as long.
    """
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
def _cholesky(cov: FloatArray) -> FloatArray:
    """The lower factor (m, m) of a covariance; NaN where it is not positive definite."""
    m = len(cov)
    factor = np.zeros((m, m))
    for i in range(m):
        for j in range(i + 1):
            rest = cov[i, j]
            for k in range(j):
                rest -= factor[i, k] * factor[j, k]
            factor[i, j] = np.sqrt(rest) if i == j else rest / factor[j, j]
    return factor


@_part
def _points(mean: FloatArray, cov: FloatArray) -> FloatArray:
    """The cubature points (2 m, m) of a normal distribution."""
    m = mean.size
    factor, points = _cholesky(cov), np.empty((2 * m, m))
    for i in range(m):
        for j in range(m):
            points[i, j] = mean[j] + np.sqrt(m) * factor[j, i]
            points[m + i, j] = mean[j] - np.sqrt(m) * factor[j, i]
    return points


@_part
def _mean(points: FloatArray) -> FloatArray:
    """The mean (m,) of points (p, m)."""
    mean = np.zeros(points.shape[1])
    for i in range(len(points)):
        for j in range(mean.size):
            mean[j] += points[i, j] / len(points)
    return mean


@_part
def _covariance(a: FloatArray, mean_a: FloatArray, b: FloatArray, mean_b: FloatArray) -> FloatArray:
    """The covariance (m, m) of points (p, m) with as many others."""
    cov = np.zeros((mean_a.size, mean_b.size))
    for i in range(len(a)):
        for j in range(mean_a.size):
            for k in range(mean_b.size):
                cov[j, k] += (a[i, j] - mean_a[j]) * (b[i, k] - mean_b[k]) / len(a)
    return cov


@_part
def _run(path: Path, points: FloatArray, k0: int, k1: int) -> tuple[FloatArray, FloatArray]:
    """The model's states (2 m, n) and outputs (2 m, columns) at one knot, from these points at another one."""
    n = path.scale.size - 2
    ends, outputs = np.empty((len(points), n)), np.empty((len(points), path.records.size))
    out, states, start = np.empty((path.records.size, 1)), np.empty((1, n)), np.empty(n)
    for i in range(len(points)):
        if path.at >= 0:
            path.plan.p[path.at] = points[i, n] * path.scale[n]
        for j in range(n):
            start[j] = points[i, j] * path.scale[j]
        integrate(path.plan, path.knots[k0 : k1 + 1], path.coefficients[k0 : k1 + 1], path.substep, start,
                  path.knots[k1 : k1 + 1], path.records, out, states, path.origin)  # fmt: skip
        for j in range(n):
            ends[i, j] = states[0, j] / path.scale[j]
        for j in range(path.records.size):
            outputs[i, j] = out[j, 0]
    return ends, outputs


@_part
def _predicted(
    path: Path, mean: FloatArray, cov: FloatArray, k0: int, k1: int
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Mean (m,) and covariance (m, m) one sample later, and the covariance of then and now."""
    m, n = mean.size, mean.size - 2
    points, moved = _points(mean, cov), np.empty((2 * mean.size, mean.size))
    ends, _ = _run(path, points, k0, k1)
    for i in range(2 * m):
        for j in range(n):  # deep in the contact a point diverges, and would spoil the mean
            change = ends[i, j] - mean[j]
            moved[i, j] = ends[i, j] if abs(change) < MOST_CHANGE else mean[j] + (1 if change > 0 else -1) * MOST_CHANGE
        for j in range(2):
            moved[i, n + j] = path.keeps[j] * points[i, n + j]
    new = _mean(moved)
    cross, spread = _covariance(points, mean, moved, new), _covariance(moved, new, moved, new)
    for i in range(m):
        spread[i, i] += path.noise[i]
    for i in range(n):
        if spread[i, i] > WIDEST**2:
            share = WIDEST / np.sqrt(spread[i, i])
            for j in range(m):
                spread[i, j] *= share
                spread[j, i] *= share
                cross[j, i] *= share
    return new, spread, cross


@_part
def _corrected(
    path: Path, mean: FloatArray, cov: FloatArray, k: int, column: int, value: float, variance: float
) -> tuple[FloatArray, FloatArray, float]:
    """Mean and covariance given a value of a column at this knot, and its log-likelihood."""
    m, n = mean.size, mean.size - 2
    points = _points(mean, cov)
    _, outputs = _run(path, points, k, k)
    off = np.empty((2 * m, 1))
    for i in range(2 * m):
        off[i, 0] = outputs[i, column]
        if column == 0:
            off[i, 0] += points[i, n + 1] * path.scale[n + 1]
            if path.at < 0:
                off[i, 0] += points[i, n] * path.scale[n]
    expected = _mean(off)
    s = variance + _covariance(off, expected, off, expected)[0, 0]
    gain = _covariance(points, mean, off, expected)
    error = value - expected[0]
    square = error * error / s
    score = -0.5 * (np.log(s) + square)
    if square > FAR * FAR:  # Huber's cost, and his weight
        score = -0.5 * (np.log(s) + FAR * (2 * np.sqrt(square) - FAR))
        s *= np.sqrt(square) / FAR
    new, left = np.empty(m), np.empty((m, m))
    for i in range(m):
        new[i] = mean[i] + gain[i, 0] * error / s
        for j in range(m):
            left[i, j] = 0.5 * (cov[i, j] + cov[j, i]) - gain[i, 0] * gain[j, 0] / s
    return new, left, score


def _run_filter(
    path: Path, times: FloatArray, y: FloatArray, variance: FloatArray, start: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
    """Log-likelihoods (N,), means (N, m) and covariances (N, m, m) of the filter, the predicted ones, and the
    covariances (N, m, m) of each sample's state with the one before; start: in units of ``path.scale``."""
    m, n, samples = path.scale.size, path.scale.size - 2, times.size
    mean, cov = start.copy(), np.eye(m)
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
    return scores, means, covs, before, spreads, crosses


_compiled_filter = compiled(lambda **options: njit(nogil=True, error_model="numpy", **options)(_run_filter))


def run_filter(
    path: Path, times: FloatArray, y: FloatArray, variance: FloatArray, start: FloatArray, smooth: bool
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Log-likelihoods (N,), means (N, m), deviations of u (N,); NaN from the sample on where the filter diverges.

    y: (N, columns), NaN where not sampled; variance: (columns,) of their white noise; start: (m,).  Works in units of
    ``path.scale``.
    """
    scores, means, covs, before, spreads, crosses = _compiled_filter(path, times, y, variance, start / path.scale)
    if smooth:  # Rauch, Tung and Striebel's smoother
        gains = np.linalg.solve(spreads[1:], crosses[1:].transpose(0, 2, 1)).transpose(0, 2, 1)
        for k in range(times.size - 2, -1, -1):
            means[k] += gains[k] @ (means[k + 1] - before[k + 1])
            covs[k] += gains[k] @ (covs[k + 1] - spreads[k + 1]) @ gains[k].T
    u = path.scale.size - 2
    return scores, means * path.scale, np.sqrt(np.maximum(covs[:, u, u], 0.0)) * path.scale[u]
