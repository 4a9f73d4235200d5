"""The relative motion of the gears, D = theta_2 - theta_1, of one segment: how likely it makes every play.

Eq. 7 gives l theta_2 = (twice the integral of a) + a / omega_res² up to damping; the commands give theta_1.  An unknown
offset and start add a parabola to D, so Legendre coefficients from the third degree on are compared.
docs/decisions/0010-severity.md has the measurements.  What else is known of a play is severity.py's.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from lostmotion.detector import legendre
from lostmotion.detector.servo import GRID_S, followed
from lostmotion.detector.window import DetectorSettings, FloatArray, Window

__all__ = ["GRID", "STEPS", "motion_log_likelihood"]

SMALLEST, LARGEST, STEPS = 1e-5, 0.3, 90
"""The plays that are compared [rad]: 0.1 um to 3 mm on a gear of 10 mm."""
GRID: FloatArray = np.geomspace(SMALLEST, LARGEST, STEPS)
FIRST_DEGREE, LAST_DEGREE = 3, 12
"""Degrees of the Legendre coefficients of D: the sensor's offset masks lower ones, the commands' steps higher ones."""
HALF_WAVES = (1.1, 1.4, 1.8, 2.25, 2.75, 3.25, 4.0, 5.2)
SHARES = (0.081, 0.105, 0.123, 0.128, 0.137, 0.158, 0.123, 0.110)
FALLS = (1.15, 1.16, 1.12, 1.09, 0.92, 0.98, 0.65, 0.45)
"""The standard deviation of coefficient k of D is SHARE (3 / k)^FALL of the play, by how many half-waves the
commanded motion makes during the segment: with frequent changes of the flank these coefficients hold a larger part
of D, and more of it at high degrees.  Measured on 1850 segments of joints with 3 to 100 mrad (``bench.outside``,
seeds 3000 to 3059 and 4000 to 4059); the energy, 0.016 to 0.070 of the play's square, is similar for trapezoids,
moves of minimum jerk and sines.  With 0.10 and 1.2 for all motions severities were 1.30 times too large in the
median, with these values 1.02 times (seeds 5000 to 5047)."""
CLEAR = 3.0
"""Coefficients of the command below so many standard deviations are ignored in the number of half-waves."""
TEMPER = 0.5
"""Power of the likelihood: the coefficients are not independent; with a half the intervals cover 95 %."""
LATE_S, OTHERWISE, GAIN, GRAVITY = 0.003, 0.15, 0.02, 5.0
"""Standard deviations of the other differences between theta_2 and the commands: a delay in addition to that of the
candidate responses (``servo``) [s], the error of the response as a share of response minus goal, the error of the lever
and of the sensor's scale, gravity along the sensor's axis [m/s² per rad]."""
COVERED, BEYOND, PARTS = 0.6, 0.03, 20
"""The share of the segment that commands have to cover, from its begin on; the part later than BEYOND after the last
one is left out, in so many steps of length, for each of which the matrices are cached."""
FIRST: NDArray[np.intp] = np.array([0])


@dataclass(frozen=True, slots=True, eq=False)
class _Paths:
    """Coefficients of D, the K degrees from FIRST_DEGREE on: gain (K, N) from accelerations, its Gram matrix (K, K),
    twice (K, N) the double integral alone; basis (N, LAST_DEGREE + 1) and project (K, N), its inverse."""

    basis: FloatArray
    project: FloatArray
    twice: FloatArray
    gain: FloatArray
    product: FloatArray


def motion_log_likelihood(
    accel: FloatArray, segment: Window, times: FloatArray, commands: FloatArray, noise: FloatArray,
    settings: DetectorSettings, chosen: NDArray[np.intp],
) -> FloatArray:  # fmt: skip
    """Log-likelihood of the coefficients of D over the grid for each noise [m/s²] and each of the chosen responses of
    the servo, shape (L, C, STEPS); empty where the commands do not cover the segment.

    The service decodes commands in batches: the last ones of a segment may be missing.
    """
    span = segment.time[-1] - segment.time[0]
    place = (times - segment.time[0]) / span
    known_part = _known_part(place)
    if not known_part:
        return np.empty((0, 0, STEPS))
    accel = accel[: round(known_part * accel.size)]
    place = 2 * place / known_part - 1
    inside = np.abs(place) < 1 + 2 * BEYOND
    place, angle = place[inside], commands[inside]
    degree = min(LAST_DEGREE + 2, place.size // 3)
    count = min(degree, LAST_DEGREE) - FIRST_DEGREE + 1
    if count < 2:
        return np.empty((0, 0, STEPS))
    fitted, covariance = _fitted(place, angle, degree)
    known = _paths(accel.size, segment.rate_hz, settings)
    commanded = known.basis[:, : degree + 1] @ fitted[: LAST_DEGREE + 1]
    degrees = slice(FIRST_DEGREE, FIRST_DEGREE + count)
    error_covariance = covariance[degrees, degrees]
    for nuisance in (GAIN * fitted[degrees], GRAVITY * (known.twice[:count] @ (commanded - commanded.mean()))):
        error_covariance = error_covariance + np.outer(nuisance, nuisance)
    grid = round(known_part * span / GRID_S)
    project = _projected(grid, degree)[degrees]
    follows, response_errors = _followed(times, commands, float(segment.time[0]), chosen, project)
    covariances = error_covariance + response_errors
    waves = _half_waves(np.where(np.abs(fitted) > CLEAR * np.sqrt(np.diagonal(covariance)), fitted, 0.0))
    difference, own = known.gain[:count] @ accel - follows, known.product[:count, :count]
    likelihoods = [_coefficient_log_likelihood(difference, covariances + one**2 * own, waves, follows) for one in noise]
    return np.array(likelihoods)


def _followed(
    times: FloatArray, commands: FloatArray, start: float, chosen: NDArray[np.intp], project: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Coefficients (C, K) of the motion behind each of the chosen responses of the servo, and the covariance (C, K, K)
    of their errors: of the delay, and of the rest of the response.  project: (K, grid) from the motion."""
    path = followed(times, commands, start, project.shape[1], chosen)
    follows, goal = path @ project.T, followed(times, commands, start, project.shape[1], FIRST) @ project.T
    late, other = LATE_S / GRID_S * (np.gradient(path, axis=1) @ project.T), OTHERWISE * (follows - goal)
    return follows, late[:, :, None] * late[:, None] + other[:, :, None] * other[:, None]


def _fitted(place: FloatArray, angle: FloatArray, degree: int) -> tuple[FloatArray, FloatArray]:
    """Coefficients of Legendre (degree + 1,) of angles at places between -1 and 1, and their covariance."""
    basis = legendre.scaled_values(place, degree)
    inverse = np.linalg.inv(basis.T @ basis + 1e-9 * place.size * np.eye(degree + 1))
    coefficients = inverse @ (basis.T @ angle)
    left = angle - basis @ coefficients
    return coefficients, inverse * float(left @ left) / (place.size - degree - 1)


def _half_waves(coefficients: FloatArray) -> float:
    """How many half-waves a motion with these coefficients of Legendre makes: 2 T f with 2 pi f the ratio of the root
    mean squares of acceleration and of speed without its mean."""
    degree = coefficients.size - 1
    plain = coefficients * np.sqrt(2 * np.arange(degree + 1) + 1)
    speed, accel = legendre.derivative(degree, 1) @ plain, legendre.derivative(degree, 2) @ plain
    speed[0] = 0.0
    slow, fast = (float(np.sum(part**2 / (2 * np.arange(part.size) + 1))) for part in (speed, accel))
    return 2 / math.pi * math.sqrt(fast / slow) if slow > 0 else 0.0


def _known_part(place: FloatArray) -> float:
    """The share of the segment, in steps, from its begin to the last command at a place 0..1 of it; 0 if too little."""
    before = place[place < 1 + BEYOND]
    share = min(math.floor((before.max() + BEYOND) * PARTS) / PARTS, 1.0) if before.size else 0.0
    return 0.0 if share < COVERED or before[before > -BEYOND].min(initial=1.0) > BEYOND else share


@lru_cache(maxsize=32)
def _projected(count: int, degree: int) -> FloatArray:
    """Legendre's coefficients from ``count`` values on an even grid, shape (degree + 1, count)."""
    return np.asarray(np.linalg.pinv(legendre.scaled_values(np.linspace(-1, 1, count), degree)), np.float64)


def _coefficient_log_likelihood(
    difference: FloatArray, error_covariance: FloatArray, half_waves: float, follows: FloatArray
) -> FloatArray:
    """Log-likelihood over the grid, shape (C, STEPS), of coefficients (C, K); their covariance is
    ``error_covariance`` (C, K, K) plus that of each play; follows: those of theta_1, (C, K).

    In flight theta_2 goes straight on, and D = -theta_1.  D therefore has the energy of a play that is crossed or
    that of theta_1, whichever is less; half of their harmonic mean stands for this."""
    count = difference.shape[1]
    first, fall = float(np.interp(half_waves, HALF_WAVES, SHARES)), float(np.interp(half_waves, HALF_WAVES, FALLS))
    share = first * (FIRST_DEGREE / np.arange(FIRST_DEGREE, FIRST_DEGREE + count)) ** fall
    # With commands that jump by 10⁹ rad the other variances are below the rounding of the largest.
    least = 1e-18 + count * np.finfo(float).eps * np.trace(error_covariance, axis1=1, axis2=2)
    lower = np.linalg.cholesky(error_covariance + least[:, None, None] * np.eye(count))
    white = np.linalg.inv(lower)
    scaled = white * share
    power, directions = np.linalg.eigh(scaled @ scaled.transpose(0, 2, 1))
    seen = (directions.transpose(0, 2, 1) @ (white @ difference[:, :, None]))[:, None, :, 0] ** 2
    free = np.maximum(np.sum(follows**2, axis=1), 1e-18)[:, None] / float(share @ share)
    moved = GRID**2 * free / (free + GRID**2)
    variance = 1 + moved[:, :, None] * np.maximum(power, 0.0)[:, None]
    deviance = np.sum(np.log(variance) + seen / variance, axis=2)
    scale = 2 * np.sum(np.log(np.diagonal(lower, axis1=1, axis2=2)), axis=1)
    return np.asarray(-TEMPER / 2 * (deviance + scale[:, None]))


@lru_cache(maxsize=16)
def _paths(length: int, rate_hz: float, settings: DetectorSettings) -> _Paths:
    """The matrices to the coefficients of D for segments of ``length`` samples."""
    basis = legendre.scaled_values(np.linspace(-1, 1, length), LAST_DEGREE)
    project: FloatArray = np.asarray(np.linalg.pinv(basis)[FIRST_DEGREE:], np.float64)
    # theta[n] = sum over k < n of (n - k) a[k] / rate²; sums over all later samples are the transpose of an integral.
    later = project[:, ::-1].cumsum(axis=1).cumsum(axis=1)[:, ::-1]
    twice = np.column_stack([later[:, 1:], np.zeros(len(later))]) / rate_hz**2 / settings.length_m
    gain = twice + project / (2 * math.pi * settings.f_res_hz) ** 2 / settings.length_m
    return _Paths(basis, project, twice, gain, gain @ gain.T)
