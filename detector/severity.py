"""Severity: the equivalent play of every window, for any size of the play, with an interval.

Where ``play_size`` has an estimate, this is that play, unless it contradicts the rest.  Elsewhere two measures of the
segment from ``BEFORE_S`` before the reversal to the window's end give the order of magnitude; they complement each
other:

* the impact: teeth that leave a flank as the commanded acceleration passes zero with the jerk j meet after the gap phi
  with the speed v = (9 j phi² / 2)^(1/3).  The amplitude of the bar's ring gives v: it is l omega_res v.  This holds
  down to the sensor's noise.  Large play, and teeth that bounce, do not come to rest before the next reversal, so v
  then grows more slowly.
* the relative motion of the gears, D = theta_2 - theta_1, whose range is at most the play.  Eq. 7 gives
  l theta_2 = (twice the integral of a) + a / omega_res² up to damping; the commands give theta_1.  An unknown offset
  and start add a parabola to D, so Legendre coefficients from the third degree on are compared.  This holds without
  impacts, with late ones and with bounces, from a few times the commands' resolution on.

A likelihood over the play combines them.  The constants are averages over three simulators and four motions; the
interval includes their differences.  docs/decisions/0010-severity.md has the measurements.  No trend and no limits
here.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from lostmotion.detector import legendre
from lostmotion.detector.play_size import LEAST_RATE
from lostmotion.detector.quality import IMPLAUSIBLE, mended
from lostmotion.detector.ring_speed import speed_of_impact
from lostmotion.detector.servo import GRID_S, UNKNOWN, ServoLaw, followed
from lostmotion.detector.window import DetectorSettings, FloatArray, Score, Window

__all__ = ["Severity", "learnt_severity", "severity", "with_severity"]

SMALLEST, LARGEST, STEPS = 1e-5, 0.3, 90
"""The plays that are compared [rad]: 0.1 um to 3 mm on a gear of 10 mm."""
FIRST_DEGREE, LAST_DEGREE = 3, 12
"""Degrees of the Legendre coefficients of D: the sensor's offset masks lower ones, the commands' steps higher ones."""
HALF_WAVES = (1.1, 1.4, 1.8, 2.25, 2.75, 3.25, 4.0, 5.2)
SHARES = (0.081, 0.105, 0.123, 0.128, 0.137, 0.158, 0.123, 0.110)
FALLS = (1.15, 1.16, 1.12, 1.09, 0.92, 0.98, 0.65, 0.45)
"""The standard deviation of coefficient k of D is SHARE (3 / k)^FALL of the play, by how many half-waves the commanded
motion makes during the segment: with frequent changes of the flank these coefficients hold a larger part of D, and more
of it at high degrees.  Measured on 1850 segments of joints with 3 to 100 mrad (``bench.outside``, seeds 3000 to 3059
and 4000 to 4059); the energy, 0.016 to 0.070 of the play's square, is similar for trapezoids, moves of minimum jerk and
sines.  With 0.10 and 1.2 for all motions, as before, severities were 1.30 times too large in the median, now 1.02 times
(seeds 5000 to 5047)."""
CLEAR = 3.0
"""Coefficients of the command below so many standard deviations are ignored in the number of half-waves."""
TEMPER = 0.5
"""Power of the likelihood: the coefficients are not independent; with a half the intervals cover 95 %."""
LATE_S, OTHERWISE, GAIN, GRAVITY = 0.003, 0.15, 0.02, 5.0
"""Standard deviations of the other differences between theta_2 and the commands: a delay in addition to that of the
candidate responses (``servo``) [s], the error of the response as a share of response minus goal, the error of the lever
and of the sensor's scale, gravity along the sensor's axis [m/s² per rad]."""
SWING_S = 0.2
"""Time over which the trigger's swing extends [s]: jerk = swing / SWING_S."""
EXCESS, KNEE_S, SLOWER = 3.0, 0.012, 0.6
"""The impact speed is that of EXCESS phi / (1 + (phi / phi_0)^SLOWER) with phi_0 = swing KNEE_S²: teeth that bounce
meet faster than from rest, and large play does not come to rest."""
SPREAD, NOISE_SPREAD = 0.65, 0.35
"""Standard deviations of ln v: between windows and gears, and of the largest ring in noise alone."""
UNSEEN = 0.002
"""Probability of no impact within the segment, or a late or a soft one: a missing ring alone excludes no large play."""
CORNER = 2.0
"""A corner in the command, a step of its acceleration by the swing, excites the bar by up to swing / omega_res; below
so many times that speed the ring is no evidence of play, and the interval begins at 0."""
WRONG = 0.4
"""Prior weight of the size of ``play_size`` being wrong, so that a wrong one does not decide alone.  With 0.1, 0.2 and
0.4 of the severities' 95 % intervals 92.6, 93.2 and 94.2 % hold on eq. 1's gears, 91.8, 92.6 and 93.4 % on hard stops,
91.0, 91.8 and 92.8 % on MuJoCo's (0.2 to 100 mrad, seed 8712); of 30 mrad they are 0.56, 0.60 and 0.71 plays wide."""
BOUNDS = np.array([1.0, 0.1])
"""The noise, as shares of its estimate, where that is an upper bound: with few samples a period fourth differences
contain the ring, and hard stops of 100 mrad never rest (5 to 20 instead of 0.5 m/s² at 200 Hz).  Of 30 and 100 mrad
there 93 and 94 % of the intervals hold instead of 85 and 86 %, of 1 mrad on eq. 1 90 instead of 97 % (seed 8720)."""
COVERED, BEYOND, PARTS = 0.6, 0.03, 20
"""The share of the segment that commands have to cover, from its begin on; the part later than BEYOND after the last
one is left out, in so many steps of length, for each of which the matrices are cached."""
PRESENT = 0.95
"""Share of a segment's samples that have to be there: an acceleration drawn over a gap integrates to a false motion."""
UNLIKELY = 2.0
"""Zero play is excluded from the interval if it is so much less likely [nats] than the best value."""
QUANTILES = (0.025, 0.5, 0.975)


@dataclass(frozen=True, slots=True)
class Severity:
    """Equivalent play [rad] with the ends of its 95 % interval, low 0 where there may be none; all NaN if unknown."""

    value: float = math.nan
    low: float = math.nan
    high: float = math.nan


@dataclass(frozen=True, slots=True, eq=False)
class _Paths:
    """Coefficients of D, the K degrees from FIRST_DEGREE on: gain (K, N) from accelerations, its Gram matrix (K, K),
    twice (K, N) the double integral alone; basis (N, LAST_DEGREE + 1) and project (K, N), its inverse."""

    basis: FloatArray
    project: FloatArray
    twice: FloatArray
    gain: FloatArray
    product: FloatArray


FIRST: NDArray[np.intp] = np.array([0])
GRID: FloatArray = np.geomspace(SMALLEST, LARGEST, STEPS)


def severity(
    segment: Window, times: Sequence[float] | FloatArray, commands: Sequence[float] | FloatArray, swing: float,
    settings: DetectorSettings, play: tuple[float, float, float] = (math.nan,) * 3, clipped: bool = False,
    servo: ServoLaw = UNKNOWN,
) -> Severity:  # fmt: skip
    """The equivalent play of one segment of tip acceleration.

    times [s] and commands [rad], shape (M,): the goal around the segment and from ``servo.SPAN_S`` before, which may be
    few or none; swing: change of the commanded acceleration at the reversal [rad/s²]; play: size of ``play_size`` with
    the ends of its 95 % interval [rad], NaN if unknown; clipped: the sensor's range was reached, so that the ring gives
    a lower bound of v; servo: the response of the servo as estimated from earlier windows.
    """
    return learnt_severity(segment, times, commands, swing, settings, play, clipped, servo)[0]


@np.errstate(over="ignore", invalid="ignore", divide="ignore")  # readings that overflow: unknown
def learnt_severity(
    segment: Window, times: Sequence[float] | FloatArray, commands: Sequence[float] | FloatArray, swing: float,
    settings: DetectorSettings, play: tuple[float, float, float], clipped: bool, servo: ServoLaw,
) -> tuple[Severity, ServoLaw]:  # fmt: skip
    """The same, and the servo's response as estimated after this window."""
    there = np.isfinite(segment.accel)
    if there.sum() < PRESENT * segment.accel.size or not swing > 0 or settings.f_res_hz >= segment.rate_hz / 2:
        return Severity(), servo
    accel = mended(segment.accel)
    if np.ptp(accel) == 0:
        return Severity(), servo
    speed, noise, least = speed_of_impact(accel, segment.rate_hz, settings)
    if not math.isfinite(speed):
        return Severity(), servo
    is_known = settings.noise_ms2 or segment.rate_hz >= LEAST_RATE * settings.f_res_hz
    levels = BOUNDS[:1] if is_known else BOUNDS
    impact = np.array([_impact_log_likelihood(speed, least * level, swing, clipped) for level in levels])
    likelihood, whole = np.zeros(STEPS), _summed(impact, 0)
    if not clipped:
        chosen = servo.chosen
        motion = _motion_log_likelihood(
            accel, segment, np.asarray(times), np.asarray(commands), noise * levels, settings, chosen
        )
        if motion.size:
            known = np.array(servo.likelihood)[chosen, None]
            of_level = _summed(known + motion, 1) - float(_summed(known, 0)[0])
            likelihood, whole = _summed(of_level, 0), _summed(of_level + impact, 0)
            servo = servo.updated(chosen, _summed(_summed(motion + impact[:, None], 2), 0))
    if (size := _size_density(play)) is not None:
        likelihood, whole = _with_size(likelihood, size), _with_size(whole, size)
    is_clear = speed > CORNER * swing / (2 * math.pi * settings.f_res_hz) or _excludes_zero(likelihood)
    return _interval(whole, is_clear), servo


def with_severity(
    score: Score, segment: Window, times: Sequence[float] | FloatArray, commands: Sequence[float] | FloatArray,
    settings: DetectorSettings, servo: ServoLaw = UNKNOWN,
) -> tuple[Score, ServoLaw]:  # fmt: skip
    """The score with the severity of its segment, and the servo's response as estimated after it; ``score.play`` is
    that of ``play_size``, where it is known."""
    if IMPLAUSIBLE in score.quality:
        return score, servo
    play = (score.play, score.play_low, score.play_high)
    found, servo = learnt_severity(
        segment, times, commands, abs(score.excitation), settings, play, "clipped" in score.quality, servo
    )
    return replace(score, severity=found.value, severity_low=found.low, severity_high=found.high), servo


def _summed(logarithms: FloatArray, axis: int) -> FloatArray:
    """Logarithm of the sum of exponentials."""
    top = np.max(logarithms, axis=axis, keepdims=True)
    return np.asarray(np.squeeze(top, axis) + np.log(np.sum(np.exp(logarithms - top), axis=axis)))


def _size_density(play: tuple[float, float, float]) -> FloatArray | None:
    """Probability over the grid of a size of the play with its 95 % interval, two halves of normal ones; None where
    there is none, or none on the grid."""
    size, low, high = play
    if not math.isfinite(size):
        return None
    deviation = np.where(size > GRID, size - low, high - size) / 1.959964
    density = GRID * np.exp(-(((GRID - size) / deviation) ** 2) / 2)
    whole = float(density.sum())
    return density / whole if whole > 0 else None


def _with_size(likelihood: FloatArray, density: FloatArray) -> FloatArray:
    """Log-likelihood over the grid where the size of the play is estimated, too: that of its density, or where the size
    is wrong the given one; how likely that is, the given one decides.

    The two are not multiplied: both come from the same motion, and of soft teeth the range of D is the gap under the
    motion's loads, a quarter less than the play.
    """
    other = np.exp(likelihood - likelihood.max())
    right, wrong = (1 - WRONG) * float(density @ other), WRONG * float(other.mean())
    mixed = (right * density + wrong * other / other.sum()) / (right + wrong)
    return np.asarray(np.log(np.maximum(mixed, 1e-300)))


def _interval(likelihood: FloatArray, is_clear: bool) -> Severity:
    """Median and 95 % interval over the grid, with a log-uniform prior."""
    density = np.exp(likelihood - likelihood.max())
    below = np.cumsum(density) / density.sum()
    low, middle, high = np.exp(np.interp(QUANTILES, below, np.log(GRID)))
    return Severity(float(middle), float(low) if is_clear and _excludes_zero(likelihood) else 0.0, float(high))


def _excludes_zero(likelihood: FloatArray) -> bool:
    """Whether zero play is unlikely."""
    return bool(likelihood[0] < likelihood.max() - UNLIKELY)


def _impact_log_likelihood(speed: float, least: float, swing: float, clipped: bool) -> FloatArray:
    """Log-likelihood of the impact speed [rad/s] over the grid; least: that of noise alone."""
    from_rest = EXCESS * GRID / (1 + (GRID / (swing * KNEE_S**2)) ** SLOWER)
    expected = np.cbrt(4.5 * swing / SWING_S * from_rest**2)
    whole = np.hypot(expected, least)
    share = (expected / whole) ** 2
    variance = SPREAD**2 * share + NOISE_SPREAD**2 * (1 - share)
    off = math.log(max(speed, 1e-9)) - np.log(whole)
    if clipped:
        off = np.maximum(off, 0.0)
    density = -(off**2) / variance / 2 - np.log(variance) / 2
    return np.where(off < 0, np.logaddexp(density, math.log(UNSEEN)), density)


def _motion_log_likelihood(
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
    path = followed(times, commands, float(segment.time[0]), grid, chosen)
    project = _projected(grid, degree)[degrees]
    follows, goal = path @ project.T, followed(times, commands, float(segment.time[0]), grid, FIRST) @ project.T
    late, response_error = LATE_S / GRID_S * (np.gradient(path, axis=1) @ project.T), OTHERWISE * (follows - goal)
    covariances = (
        error_covariance + late[:, :, None] * late[:, None] + response_error[:, :, None] * response_error[:, None]
    )
    waves = _half_waves(np.where(np.abs(fitted) > CLEAR * np.sqrt(np.diagonal(covariance)), fitted, 0.0))
    difference, own = known.gain[:count] @ accel - follows, known.product[:count, :count]
    likelihoods = [_coefficient_log_likelihood(difference, covariances + one**2 * own, waves, follows) for one in noise]
    return np.array(likelihoods)


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

    In flight theta_2 goes straight on, D = - theta_1: D has the energy of a play that is crossed or that of theta_1,
    whichever is less, here half their harmonic mean."""
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
