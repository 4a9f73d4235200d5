"""How large the play is, from one reversal: the bar's ring tells how the joint moved, the command how the gear did.

The accelerometer at the bar's tip knows every kick that the joint gets: eq. 7 turned round.  Between kicks the driven
gear flies freely, so its angle follows from them by integration, up to a constant speed and angle.  Each kick is a
contact, on the flank that its sign tells, and there

    theta_2(t_k) + a + b t_k = theta_1(t_k) - sign_k X_k phi / 2,    X = (|theta_2''| / A)^(1/n),

of which a, b and the play phi are found by generalised least squares.  X is eq. 1's: d is the gap at which the force
reaches beta, and at less force the teeth meet before; n is ``settings.flank_exponent`` (11 as in the model; 1000 and
more for teeth without give), A = beta R2 / J2 = 1000 rad/s² as in the model.  Nothing here depends on friction,
restitution or the order of bounces; docs/decisions/0007-play-size.md has the measurements.  No trigger, no trend.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from lostmotion.detector.commanded import BEFORE_S, Commanded, smoothed
from lostmotion.detector.kicks import Inverse, inverse, noise_of
from lostmotion.detector.window import DetectorSettings, FloatArray, Score, Window
from lostmotion.detector.windows import cut

__all__ = ["PlaySize", "play_size", "pooled", "stretch_of", "with_play"]

LEAST_RATE = 8.0
"""Samples a period of the bar: with fewer, kicks cannot be told from each other."""
LEAST_KICK, SIGNIFICANT = 0.02, 6.0
"""A contact changes the speed by so much [rad/s] within three steps, and stands out by so many standard deviations."""
LEAST_CONTACTS = 4
CONTACT_ACCEL = 1000.0
"""Acceleration of the joint under the force beta at the teeth [rad/s²]: beta R2 / J2 of the model."""
FLANK, GRAIN = 0.06, 5e-5
"""Where on a flank a contact is: standard deviation as a share of half the play, and least [rad]."""
BIAS, GRAVITY = 0.1, 10.0
"""What may remain of an offset, and gravity along the sensor's axis [m/s²], standard deviations."""
ROUNDS = 3
LEAST_PLAY, MOST_PLAY = 5e-4, 0.05
"""Play that scales the flanks' error [rad]."""
Z = 1.959964


@dataclass(frozen=True, slots=True)
class PlaySize:
    """Lost motion at the joint [rad] with the ends of its 95 % interval; all NaN where reason says why not."""

    value: float
    low: float
    high: float
    reason: str = ""


def play_size(
    stretch: Window, servo_times: Sequence[float] | FloatArray, commands: Sequence[float] | FloatArray,
    settings: DetectorSettings,
) -> PlaySize:  # fmt: skip
    """The play that one stretch of tip acceleration shows, from ``BEFORE_S`` before a reversal to the window's end.

    servo_times [s] and commands [rad], shape (M,): what was commanded during the stretch and somewhat before; stretch:
    none of its samples missing.  With the settings' noise and bar the median error is near 10 % from 2 mrad up.
    """
    rate_hz = stretch.rate_hz
    if rate_hz < LEAST_RATE * settings.f_res_hz:
        return _unknown(f"the sensor is too slow: {LEAST_RATE:g} samples a period of the bar are needed")
    if not np.isfinite(stretch.accel).all():
        return _unknown("samples are missing")
    command = smoothed(np.asarray(servo_times), np.asarray(commands), stretch)
    if command is None:
        return _unknown("too few commands during the stretch")
    local = stretch.time - stretch.time[0]
    told = local <= command.end
    offset = float(np.mean(stretch.accel[told] - settings.length_m * command.acceleration(local[told])))
    undone = inverse(stretch.accel.size, rate_hz, noise_of(stretch.accel, settings), settings)
    kicks = undone.gain @ (stretch.accel - offset)
    together = np.convolve(kicks, np.ones(3), "same")
    where = _contacts(together, np.abs(together) / undone.deviation)
    where = where[undone.times[where] <= command.end]
    if where.size < LEAST_CONTACTS or np.ptp(np.sign(together[where])) == 0:
        return _unknown("the teeth did not strike both flanks clearly")
    return _solve(undone, kicks, together, where, command, settings)


def pooled(values: Sequence[float] | FloatArray) -> PlaySize:
    """The median of many windows' plays [rad], NaN left out, with its 95 % interval (binomial; needs 6 windows)."""
    known = np.sort([value for value in values if math.isfinite(value)])
    if known.size < 6:
        return _unknown(f"{known.size} windows tell a play; expected at least 6")
    reach = Z * math.sqrt(known.size) / 2
    low, high = math.floor(known.size / 2 - reach), math.ceil(known.size / 2 + reach) - 1
    return PlaySize(float(np.median(known)), float(known[max(low, 0)]), float(known[min(high, known.size - 1)]))


def stretch_of(score: Score, times: FloatArray, accel: FloatArray, rate_hz: float) -> Window:
    """The stretch that tells the play of a score's window, from a stream of tip acceleration that holds it."""
    return cut(score.joint, times, accel, score.time - BEFORE_S, score.duration + BEFORE_S, rate_hz)


def with_play(
    score: Score, stretch: Window, servo_times: Sequence[float] | FloatArray, commands: Sequence[float] | FloatArray,
    settings: DetectorSettings,
) -> Score:  # fmt: skip
    """The score with the play that its stretch shows, or the reason why it cannot be told."""
    if not settings.play_size or not score.impact or "clipped" in score.quality:
        reason = "not asked for" if not settings.play_size else "clipped" if score.impact else "no impact"
        return replace(score, play_reason=reason)
    size = play_size(stretch, servo_times, commands, settings)
    return replace(score, play=size.value, play_low=size.low, play_high=size.high, play_reason=size.reason)


def _unknown(reason: str) -> PlaySize:
    return PlaySize(math.nan, math.nan, math.nan, reason)


def _contacts(kicks: FloatArray, clarity: FloatArray) -> np.ndarray[tuple[int], np.dtype[np.intp]]:
    """Where kicks are largest among their neighbours, and clear."""
    size = np.abs(kicks)
    peak = (size[1:-1] >= size[:-2]) & (size[1:-1] > size[2:])
    return np.flatnonzero(peak & (size[1:-1] > LEAST_KICK) & (clarity[1:-1] > SIGNIFICANT)) + 1


@lru_cache(maxsize=16)
def _doubt(undone: Inverse) -> FloatArray:
    """Covariance of the angles that kicks make, shape (K, K)."""
    return np.asarray(undone.twice @ undone.covariance @ undone.twice.T)


def _solve(
    undone: Inverse, kicks: FloatArray, together: FloatArray, where: np.ndarray[tuple[int], np.dtype[np.intp]],
    command: Commanded, settings: DetectorSettings,
) -> PlaySize:  # fmt: skip
    """Generalised least squares for a, b and phi, the flanks' error growing with phi."""
    time = undone.times[where]
    basis = command.basis(np.minimum(undone.times, command.end))
    commanded = basis @ command.coefficients
    twice = undone.twice[where]
    apart = twice @ kicks - commanded[where]
    step = float(undone.times[1] - undone.times[0])
    curve = (time - time.mean()) ** 2 * (BIAS / settings.length_m / 2)
    tilt = twice @ (commanded - commanded.mean()) * step * (GRAVITY / settings.length_m)
    known = _doubt(undone)[np.ix_(where, where)] + basis[where] @ command.covariance @ basis[where].T
    known += np.outer(curve, curve) + np.outer(tilt, tilt) + GRAIN**2 * np.eye(where.size)
    # Three steps of the grid hold a contact whose force has about the shape of a half sine.
    closed = np.minimum(np.abs(together[where]) / (2 * step) / CONTACT_ACCEL, 1.0) ** (1 / settings.flank_exponent)
    design = np.column_stack([np.ones(where.size), time, np.sign(together[where]) * closed / 2])
    both, one = np.column_stack([design, apart]), np.eye(where.size)
    play = LEAST_PLAY
    for _ in range(ROUNDS):
        flank = FLANK * min(max(play, LEAST_PLAY), MOST_PLAY) / 2
        weighted = design.T @ np.linalg.solve(known + flank**2 * one, both)
        covariance = np.linalg.inv(weighted[:, :3])
        play = float(-(covariance @ weighted[:, 3])[2])
    half = Z * math.sqrt(float(covariance[2, 2]))
    if play <= half:
        return _unknown("the play is lost in its own uncertainty")
    return PlaySize(play, play - half, play + half)
