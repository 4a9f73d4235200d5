"""Severity: the equivalent play of every window, for any size of the play, with an interval.

Where ``play_size`` has an estimate, this is that play, unless it contradicts the rest.  Elsewhere two measures of the
segment from ``BEFORE_S`` before the reversal to the window's end give the order of magnitude; they complement each
other:

* the impact: teeth that leave a flank as the commanded acceleration passes zero with the jerk j meet after the gap phi
  with the speed v = (9 j phi² / 2)^(1/3).  The amplitude of the bar's ring gives v: it is l omega_res v.  This holds
  down to the sensor's noise.  Large play, and teeth that bounce, do not come to rest before the next reversal, so v
  then grows more slowly.
* the relative motion of the gears, D = theta_2 - theta_1, whose range is at most the play (``motion_likelihood``).
  This holds without impacts, with late ones and with bounces, from a few times the commands' resolution on.

A likelihood over the play combines them.  The constants are averages over three simulators and four motions; the
interval includes their differences.  docs/decisions/0010-severity.md has the measurements.  No trend and no limits
here.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from lostmotion.detector.motion_likelihood import GRID, STEPS, motion_log_likelihood
from lostmotion.detector.play_size import LEAST_RATE
from lostmotion.detector.pooling import Z
from lostmotion.detector.quality import IMPLAUSIBLE, mended
from lostmotion.detector.ring_speed import speed_of_impact
from lostmotion.detector.servo import UNKNOWN, ServoLaw
from lostmotion.detector.window import DetectorSettings, FloatArray, Score, Window

__all__ = ["Severity", "learnt_severity", "severity", "with_severity"]

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
"""Prior probability that the size of ``play_size`` is wrong, so that a wrong one does not decide alone.  With 0.1,
0.2 and 0.4 the severities' 95 % intervals hold in 92.6, 93.2 and 94.2 % of the windows on eq. 1's gears, in 91.8,
92.6 and 93.4 % on hard stops, and in 91.0, 91.8 and 92.8 % on MuJoCo's (0.2 to 100 mrad, seed 8712).  For a play of
30 mrad they are 0.56, 0.60 and 0.71 plays wide."""
BOUNDS = np.array([1.0, 0.1])
"""Noises that are compared, as shares of the estimate, where that is an upper bound only: with few samples a period
the fourth differences contain the ring, and a joint between stops 100 mrad apart never rests (an estimate of 5 to 20
instead of 0.5 m/s² at 200 Hz).  With these two 93 and 94 % of the intervals of 30 and 100 mrad hold there, instead of
85 and 86 %, but 90 instead of 97 % of 1 mrad on eq. 1 (seed 8720)."""
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
        motion = motion_log_likelihood(
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
    deviation = np.where(size > GRID, size - low, high - size) / Z
    density = GRID * np.exp(-(((GRID - size) / deviation) ** 2) / 2)
    whole = float(density.sum())
    return density / whole if whole > 0 else None


def _with_size(likelihood: FloatArray, density: FloatArray) -> FloatArray:
    """Log-likelihood over the grid if the size of the play is estimated, too: a mixture of the density of that size,
    and of the given likelihood in case the size is wrong.  How likely the given one makes the size decides between the
    two.

    The two are not multiplied, because both come from the same motion, and because the range of D of soft teeth is
    the gap under the motion's loads, a quarter less than the play.
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
