"""An input as a piecewise polynomial, the form in which the solver reads it.  No physics.

Between two knots stands the polynomial of degree five through value, velocity and acceleration at both.  It
reproduces the cubic spline of samples exactly when the knots are the samples, and a closed form to about
(2 pi f h)^6 / 46080 of its amplitude: 1e-9 for 30 Hz at h = 1 ms.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from lostmotion.model.errors import ModelError
from lostmotion.model.motion import FloatArray, Motion, Sampled

__all__ = ["Pieces", "are_alike", "cut"]

KNOT_S = 1e-3
TOLERANCE = 1e-9
"""Largest error at the middle of the pieces, as a share of the input's largest magnitude."""
ROUNDING = 1e-9
"""Largest difference of times that are the same, as a share of the length of a run."""


@dataclass(frozen=True)
class Pieces:
    """knots: (K + 1,) [s] from the start; coefficients: (K, 6), lowest order first, in the time since each knot;
    speed and acceleration: largest magnitude of the derivatives at the knots."""

    knots: FloatArray
    coefficients: FloatArray
    speed: float
    acceleration: float


def cut(drive: Motion | None, start: float, length: float, delay: float = 0.0) -> Pieces:
    """The input drive(t - delay) for t from start to start + length [s]; zero without a drive.

    Raises ModelError when the motion gives numbers that are not finite.
    """
    if drive is None:
        return Pieces(np.array([0.0, length]), np.zeros((1, 6)), 0.0, 0.0)
    if isinstance(drive, Sampled):
        return _through_samples(drive, start - delay, length)
    for halvings in range(4):
        knots = np.linspace(0.0, length, max(1, round(length / KNOT_S)) * 2**halvings + 1)
        times = knots + (start - delay)
        values = (np.asarray(f(times), dtype=float) for f in (drive.position, drive.velocity, drive.acceleration))
        pieces = _through(drive, knots, *values)
        if _middle_error(drive, pieces, start - delay) <= TOLERANCE:
            break
    return pieces


def are_alike(one: FloatArray, other: FloatArray) -> bool:
    """Whether two arrays of times are the same but for rounding."""
    return one is other or (one.size == other.size and bool(np.abs(one - other).max() <= ROUNDING * one[-1]))


@lru_cache(maxsize=256)  # a fit asks for the same stretches of a few recordings thousands of times
def _through_samples(drive: Sampled, origin: float, length: float) -> Pieces:
    """The spline itself: knots at the samples, and at both ends of the stretch."""
    ends = np.array([origin, origin + length])
    # A sample this close to an end counts as that end: a piece without length has no polynomial.
    margin = 1e-3 * min(length, np.ptp(drive.time) / (drive.time.size - 1))
    first, last = np.searchsorted(drive.time, (origin + margin, origin + length - margin))
    knots = np.concatenate(([0.0], drive.time[first:last] - origin, [length]))
    at_ends = (drive.position(ends), drive.velocity(ends), drive.acceleration(ends))
    values = (
        np.concatenate((end[:1], node[first:last], end[1:])) for end, node in zip(at_ends, drive.nodes, strict=True)
    )
    return _through(drive, knots, *values)


def _through(drive: Motion, knots: FloatArray, x: FloatArray, v: FloatArray, a: FloatArray) -> Pieces:
    """The pieces through values x, rates v and second derivatives a at the knots, all (K + 1,)."""
    if not (x.shape == v.shape == a.shape == knots.shape and np.all(np.isfinite(x + v + a))):
        raise ModelError(f"the motion {drive!r} does not give one finite number for each time")
    h = np.diff(knots)
    # what is left of value, h velocity and h² acceleration at the right end after the left end's parabola
    dx = x[1:] - x[:-1] - h * (v[:-1] + h * a[:-1] / 2)
    dv = h * (v[1:] - v[:-1] - h * a[:-1])
    da = h**2 * (a[1:] - a[:-1])
    third, fourth, fifth = 10 * dx - 4 * dv + da / 2, -15 * dx + 7 * dv - da, 6 * dx - 3 * dv + da / 2
    coefficients = np.stack((x[:-1], v[:-1], a[:-1] / 2, third / h**3, fourth / h**4, fifth / h**5), axis=1)
    return Pieces(knots, coefficients, float(np.max(np.abs(v))), float(np.max(np.abs(a))))


def _middle_error(drive: Motion, pieces: Pieces, origin: float) -> float:
    """Largest error in the middle of the pieces over the largest magnitude of the input."""
    half = np.diff(pieces.knots) / 2
    exact = drive.position(pieces.knots[:-1] + half + origin)
    value = np.zeros_like(half)
    for c in pieces.coefficients.T[::-1]:
        value = value * half + c
    return float(np.max(np.abs(value - exact)) / max(np.max(np.abs(exact)), 1e-300))
