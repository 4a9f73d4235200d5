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
from numpy.lib.stride_tricks import sliding_window_view

from lostmotion.detector.window import FloatArray

__all__ = ["LEAST_SPAN_S", "LONGEST_DELAY_S", "Lever", "delay", "levers"]

STEP_S = 0.02
"""Grid on which angles and readings are compared [s]."""
KERNEL_S = 0.24
"""Length of the Hann kernel that smooths both [s]: it passes motions of arms (half at 4 Hz), not rings of bars."""
HALF_S = STEP_S / 2
LAGS = range(-4, 5)
"""Lags of the angles behind the readings that are tried, in halves of the grid's step: servos report late."""
LONGEST_DELAY_S = 1.0
LAST_DELAY = round(LONGEST_DELAY_S / HALF_S)
DELAYS = range(-LAST_DELAY, LAST_DELAY + 1, 4)
"""Delays of the readings that are looked for, up to LONGEST_DELAY_S either way, in halves of the grid's step."""
USUAL_DELAYS_S = (-0.06, 0.16)
"""Delays that the detector allows for [s]: readings 0.15 s late left the severity of a healthy joint at 0.3', 0.2 s
late made it 38' (emulated AX-12A, a minute each)."""
SURELY = 0.25
"""A delay is sure that leaves less than this share of what the usual ones leave of the squared readings."""
LEAST_SPAN_S = 1.8
"""In a shorter segment theta'' and theta of a swaying arm are nearly collinear [s]."""
INNER = slice(2, -2)
"""The samples with two neighbours on either side: second differences are one-sided at the edges."""
ROUNDING = 1e-10
"""Least eigenvalue of the normal equations of regressors of unit length: below it the numbers' rounding decides, as
with theta'' and theta of a sine, and the residual of any delay would be a matter of chance."""
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
    on_grid = _on_grid(times, accel, joints, (LAGS[0] * HALF_S, LAGS[-1] * HALF_S))
    if on_grid is None:
        return None
    reading, grid = on_grid
    many = len(joints)
    freedom = (reading.size - 4) * STEP_S / (KERNEL_S * 2 / 3) - 2 * many - 1  # smoothed readings are not independent
    if freedom < 1:
        return None
    fits = _fits(reading, grid, LAGS, joints)
    if not fits:
        return None
    left, values, spread, moved = min(fits.values(), key=lambda fit: fit[0])
    rows = zip(values[:many], spread[:many] * math.sqrt(left / freedom), moved, strict=True)
    return tuple(Lever(*map(float, row)) for row in rows)


def delay(times: FloatArray, accel: FloatArray, joints: Sequence[tuple[FloatArray, FloatArray]]) -> float:
    """By how much the readings come after the angles [s], negative for before; 0 where that is usual or not sure.

    Arguments are those of ``levers``, angles from ``LONGEST_DELAY_S`` before the segment that is compared to as long
    after it.  A motion that repeats itself fits at several delays equally well, so none of them is sure.
    """
    on_grid = _on_grid(times, accel, joints, (-LONGEST_DELAY_S, LONGEST_DELAY_S))
    if on_grid is None:
        return 0.0
    reading, grid = on_grid
    left = {-lag * HALF_S: fit[0] for lag, fit in _fits(reading, grid, DELAYS, joints).items()}
    usual = [left[late] for late in left if USUAL_DELAYS_S[0] <= late <= USUAL_DELAYS_S[1]]
    found = min(left, key=left.__getitem__, default=0.0)
    return found if usual and left[found] < SURELY * min(usual) else 0.0


def _on_grid(
    times: FloatArray, accel: FloatArray, joints: Sequence[tuple[FloatArray, FloatArray]], lags: tuple[float, float]
) -> tuple[FloatArray, FloatArray] | None:
    """Smoothed readings and the times [s] before their smoothing, which angles cover at lags from the first to the
    last; None where that is too short or has too many gaps."""
    there = np.isfinite(accel)
    times, accel = times[there], accel[there]
    if not times.size or any(not at.size for at, _ in joints):
        return None
    start = max(times[0], *(at[0] - lags[0] for at, _ in joints))
    count = math.floor((min(times[-1], *(at[-1] - lags[1] for at, _ in joints)) - start) / STEP_S)
    reading = _binned(times - start, accel, count) if count >= LEAST_SPAN_S / STEP_S else None
    return None if reading is None else (_smooth(reading), start + (np.arange(count) + 0.5) * STEP_S)


Fit = tuple[float, FloatArray, FloatArray, FloatArray]
"""Residual sum of squares, coefficients, their errors for a residual of 1, and the rms accelerations."""


def _fits(
    reading: FloatArray, grid: FloatArray, lags: range, joints: Sequence[tuple[FloatArray, FloatArray]]
) -> dict[int, Fit]:
    """Least squares with the angles that many halves of a step after the times ``grid`` [s], by the lag."""
    found: dict[int, Fit] = {}
    wanted = reading[INNER] - reading[INNER].mean()
    for half in {lag % 2 for lag in lags}:
        steps = [lag // 2 for lag in lags if lag % 2 == half]
        table = _regressors(grid[0] + half * HALF_S + STEP_S * np.arange(min(steps), grid.size + max(steps)), joints)
        parts = sliding_window_view(table, reading.size, axis=0)[np.array(steps) - min(steps), :, INNER]
        parts -= parts.mean(axis=2, keepdims=True)
        moved = np.sqrt(np.mean(parts[:, : len(joints)] ** 2, axis=2))
        for step, left, *fit in zip(steps, *_solve(parts, wanted), moved, strict=True):
            if math.isfinite(left):
                found[2 * step + half] = (float(left), *fit)
    return found


def _regressors(times: FloatArray, joints: Sequence[tuple[FloatArray, FloatArray]]) -> FloatArray:
    """Smoothed accelerations and angles of the joints; see ``INNER``."""
    angles = [_smooth(np.interp(times, at, angle)) for at, angle in joints]
    return np.column_stack([*(np.gradient(np.gradient(angle, STEP_S), STEP_S) for angle in angles), *angles])


def _solve(tables: FloatArray, wanted: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Residual sums of squares (L,), coefficients and their errors for a residual of 1, (L, K) both, of regressors (L,
    K, N) at L lags: errors are infinite without motion, and all is NaN where numbers overflow."""
    size = np.sqrt(np.einsum("lkn,lkn->lk", tables, tables))
    scale = np.divide(1.0, size, out=np.zeros_like(size), where=size > 0)
    scaled = tables * scale[:, :, None]
    try:
        own, ways = np.linalg.eigh(scaled @ scaled.transpose(0, 2, 1))
    except np.linalg.LinAlgError:
        return np.full(len(size), np.nan), size, size
    inverse = (ways / np.maximum(own, ROUNDING)[:, None]) @ ways.transpose(0, 2, 1)
    found = (inverse @ (scaled @ wanted)[:, :, None])[:, :, 0]
    left = wanted - (found[:, None] @ scaled)[:, 0]
    errors = np.where(size > 0, np.sqrt(np.abs(np.diagonal(inverse, axis1=1, axis2=2))) * scale, np.inf)
    return np.einsum("ln,ln->l", left, left), found * scale, errors


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
