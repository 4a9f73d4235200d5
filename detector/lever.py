"""The lever arm of a joint at an accelerometer, from its readings: 0 if the joint does not move it.  No trigger, no
score.

A tangential accelerometer at a distance l from a joint's axis measures, slowly compared with its bar's resonance,

    a(t) = sum over joints of (l_j theta_j''(t) + g_j theta_j(t)) + constant,

where g_j is what gravity contributes as the sensor turns.  The l_j are found by least squares from the measured angles
of the joints.  One whose sensor points along another axis, or has come loose, shows l_j = 0.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lostmotion.detector.window import FloatArray

__all__ = ["LEAST_SPAN_S", "Lever", "levers"]

STEP_S = 0.02
"""Grid on which angles and readings are compared [s]."""
KERNEL_S = 0.24
"""Length of the Hann kernel that smooths both [s]: it passes motions of arms (half at 4 Hz), not rings of bars."""
LAGS_S = (-0.04, -0.03, -0.02, -0.01, 0.0, 0.01, 0.02, 0.03, 0.04)
"""Lags of the angles behind the readings that are tried [s]: servos report late."""
LEAST_SPAN_S = 1.8
"""In a shorter segment theta'' and theta of a swaying arm are nearly collinear [s]."""
LEAST_BINS = 0.9
"""Least share of the grid with readings."""


@dataclass(frozen=True, slots=True)
class Lever:
    """The lever arm of a joint from the readings [m], its standard error [m], rms of the joint's smoothed acceleration
    [rad/s²]."""

    value: float
    error: float
    motion: float


def levers(
    times: FloatArray, accel: FloatArray, joints: Sequence[tuple[FloatArray, FloatArray]]
) -> tuple[Lever, ...] | None:
    """The lever arm of each joint on one accelerometer; None where the segment is too short or has too many gaps.

    times [s] and accel [m/s²], shape (N,), NaN where a sample is missing; joints: measured angles, for each times [s]
    and angles [rad], shape (M,), ascending.  The error of a joint that moves like another one, or like a pendulum would
    (theta'' proportional to theta), is large: its lever cannot be estimated.
    """
    there = np.isfinite(accel)
    times, accel = times[there], accel[there]
    if not times.size or any(not at.size for at, _ in joints):
        return None
    start = max(times[0], *(at[0] + LAGS_S[-1] for at, _ in joints))
    count = math.floor((min(times[-1], *(at[-1] + LAGS_S[0] for at, _ in joints)) - start) / STEP_S)
    reading = _binned(times - start, accel, count) if count >= LEAST_SPAN_S / STEP_S else None
    if reading is None:
        return None
    return _fit(_smooth(reading), start + (np.arange(count) + 0.5) * STEP_S, joints)


def _fit(
    reading: FloatArray, grid: FloatArray, joints: Sequence[tuple[FloatArray, FloatArray]]
) -> tuple[Lever, ...] | None:
    """Least squares at the lag with the least residual."""
    inner, many = slice(2, -2), len(joints)  # second differences are one-sided at the edges
    wanted = reading[inner] - reading[inner].mean()
    freedom = wanted.size * STEP_S / (KERNEL_S * 2 / 3) - 2 * many - 1  # smoothed readings are not independent
    if freedom < 1:
        return None
    best: tuple[float, FloatArray, FloatArray, FloatArray] | None = None
    for lag in LAGS_S:
        angles = [_smooth(np.interp(grid + lag, at, angle)) for at, angle in joints]
        curved = [np.gradient(np.gradient(angle, STEP_S), STEP_S) for angle in angles]
        table = np.column_stack([column[inner] - column[inner].mean() for column in (*curved, *angles)])
        solved = _solve(table, wanted)
        if solved is not None and (best is None or solved[0] < best[0]):
            best = (*solved, table[:, :many].std(axis=0))
    if best is None:
        return None
    left, values, spread, moved = best
    rows = zip(values[:many], spread[:many] * math.sqrt(left / freedom), moved, strict=True)
    return tuple(Lever(*map(float, row)) for row in rows)


def _solve(table: FloatArray, wanted: FloatArray) -> tuple[float, FloatArray, FloatArray] | None:
    """Residual sum of squares, coefficients, and their errors for a residual of 1: infinite without motion."""
    size = np.sqrt((table**2).sum(axis=0))
    moves = size > 0
    values, errors = np.zeros(size.size), np.full(size.size, np.inf)
    scaled = table[:, moves] / size[moves]
    try:
        inverse = np.linalg.inv(scaled.T @ scaled)
    except np.linalg.LinAlgError:
        return None
    found = inverse @ (scaled.T @ wanted)
    left = wanted - scaled @ found
    values[moves] = found / size[moves]
    errors[moves] = np.sqrt(np.abs(np.diag(inverse))) / size[moves]
    return float(left @ left), values, errors


def _binned(local: FloatArray, accel: FloatArray, count: int) -> FloatArray | None:
    """Means over the steps of the grid; those without a reading are interpolated."""
    place = np.floor(local / STEP_S).astype(np.intp)
    inside = (place >= 0) & (place < count)
    many = np.bincount(place[inside], minlength=count)
    held = many > 0
    if np.count_nonzero(held) < LEAST_BINS * count:
        return None
    mean = np.bincount(place[inside], accel[inside], count)[held] / many[held]
    return np.interp(np.arange(count), np.flatnonzero(held), mean)


def _smooth(values: FloatArray) -> FloatArray:
    """Weighted means by the kernel, of unit sum; shorter by its length."""
    kernel = np.hanning(round(KERNEL_S / STEP_S) + 2)[1:-1]
    return np.convolve(values, kernel / kernel.sum(), "valid")
