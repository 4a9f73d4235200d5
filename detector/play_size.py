"""How large the play is, from one reversal: the bar's ring tells how the joint moved, the command how the gear did.

The accelerometer at the bar's tip knows every impulse that the joint gets: eq. 7 turned round, which holds whatever
pushes the joint, the bar's own reaction too.  Impulses integrated twice are the joint's angle theta_2, up to a constant
speed and angle, so D = theta_2 - theta_1 is known but for a + b t and with the covariance of impulses and command.
Where the joint touches a flank (``contacts``: it is struck, or pushed along) and is accelerated in the direction s,

    D(t_k) = a + b t_k - s_k X_k phi / 2,    X = (|theta_2''| / A)^(1/n),

of which a, b and the play phi are found by generalised least squares; elsewhere D is between the flanks.  The fit says
where D was meanwhile; contacts that it contradicts go, and rests grow to where the command's acceleration ends, until
nothing changes.  X is eq. 1's, see ``flank``.  Friction, restitution and the order of bounces play no part.
docs/decisions/0007-play-size.md has the measurements.  No trigger, no trend.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from lostmotion.detector.commanded import BEFORE_S, smoothed
from lostmotion.detector.contact_fit import Solved, lag_information, sized, solve
from lostmotion.detector.flank import FlankLaw, Sized, law_of
from lostmotion.detector.offset import OFFSET_UNKNOWN, OffsetLaw
from lostmotion.detector.pooling import SHOWN_UNKNOWN, PlaySize, ShownLaw, Z, unknown
from lostmotion.detector.relative_motion import relative_motion
from lostmotion.detector.servo import AT_ONCE, ServoLaw
from lostmotion.detector.window import DetectorSettings, FloatArray, Score, Window
from lostmotion.detector.windows import cut, last_part

__all__ = ["HISTORY_S", "SizeLaw", "learnt_play", "near_part", "play_size", "stretch_of", "with_play"]

HISTORY_S = 0.6
"""A stretch begins so long before the reversal [s], so that it holds several crossings of the gap: with 0.2 s of the
windows above 30 dB 65 % told a size, with 0.4 s 76 %, with 0.6 s 81 %; 95.6, 94.4 and 94.1 % of the intervals held (52
joints of ``bench.outside``, seeds 3000 to 3059)."""
LEAST_RATE = 8.0
"""Samples a period of the bar: with fewer, impulses cannot be told from each other."""
LEARNT = 0.015
"""Standard deviation of the servo's delay [s] above which nothing is told: after some five windows it is less."""


@dataclass(frozen=True, slots=True)
class SizeLaw:
    """What a joint's earlier windows told: its sensor's offset, and whether it has a play."""

    offset: OffsetLaw = OFFSET_UNKNOWN
    shown: ShownLaw = SHOWN_UNKNOWN


NOTHING_KNOWN = SizeLaw()
"""Before the first window."""


def play_size(
    stretch: Window, servo_times: Sequence[float] | FloatArray, commands: Sequence[float] | FloatArray,
    settings: DetectorSettings, law: FlankLaw | None = None, servo: ServoLaw = AT_ONCE,
) -> PlaySize:  # fmt: skip
    """The play that one stretch of tip acceleration shows, from some time before a reversal to the window's end.

    servo_times [s] and commands [rad], shape (M,): what was commanded during the stretch and somewhat before; stretch:
    none of its samples missing; law: what earlier windows told of the joint's flanks, servo: of how its servo follows
    the commands.
    """
    told = _told(stretch, np.asarray(servo_times), np.asarray(commands), settings, servo, NOTHING_KNOWN)[0]
    if isinstance(told, PlaySize):
        return told
    return _under(told, law or law_of(settings), _shown(told, SHOWN_UNKNOWN))


def stretch_of(score: Score, times: FloatArray, accel: FloatArray, rate_hz: float) -> Window:
    """The stretch that tells the play of a score's window, from a stream of tip acceleration that holds it."""
    return cut(score.joint, times, accel, score.time - HISTORY_S, score.duration + HISTORY_S, rate_hz)


def near_part(score: Score, stretch: Window) -> Window:
    """Of a stretch that which tells the severity: from ``BEFORE_S`` before the reversal on."""
    return last_part(stretch, score.duration + BEFORE_S)


def with_play(
    score: Score, stretch: Window, servo_times: Sequence[float] | FloatArray, commands: Sequence[float] | FloatArray,
    settings: DetectorSettings,
) -> Score:  # fmt: skip
    """The score with the play that its stretch alone shows, or the reason why it cannot be told."""
    return learnt_play(score, stretch, servo_times, commands, settings, law_of(settings))[0]


def learnt_play(
    score: Score, stretch: Window, servo_times: Sequence[float] | FloatArray, commands: Sequence[float] | FloatArray,
    settings: DetectorSettings, law: FlankLaw, servo: ServoLaw = AT_ONCE, known: SizeLaw = NOTHING_KNOWN,
) -> tuple[Score, FlankLaw, SizeLaw, ServoLaw]:  # fmt: skip
    """The score with the play that its stretch shows to one who knows the law of the flanks, how the servo follows,
    what the sensor reads beside motion; what is known after this window."""
    if not settings.play_size or not score.impact or "clipped" in score.quality:
        reason = "not asked for" if not settings.play_size else "clipped" if score.impact else "no impact"
        return replace(score, play_reason=reason), law, known, servo
    times = np.asarray(servo_times)
    if not np.isfinite(stretch.accel).all() or not times.size or times[0] > stretch.start:
        stretch = near_part(score, stretch)
    told, known, servo = _told(stretch, times, np.asarray(commands), settings, servo, known)
    if isinstance(told, Sized):
        law = law.updated(told)
        known = replace(known, shown=_shown(told, known.shown))
        told = _under(told, law, known.shown)
    score = replace(score, play=told.value, play_low=told.low, play_high=told.high, play_reason=told.reason)
    return score, law, known, servo


def _shown(told: Sized, shown: ShownLaw) -> ShownLaw:
    """Whether windows show a play, after one more, whatever the teeth are: what follows the acceleration of a joint
    without play looks like soft teeth."""
    least = int(np.argmin(told.play / told.deviation))
    return shown.updated(float(told.play[least]), float(told.deviation[least]))


def _under(told: Sized, law: FlankLaw, shown: ShownLaw) -> PlaySize:
    """The play under a law of the flanks; none where all windows together show none."""
    if not shown.is_shown:
        return unknown("the play is lost in its own uncertainty")
    return PlaySize(*law.interval(told, Z))


def _told(
    stretch: Window, times: FloatArray, commands: FloatArray, settings: DetectorSettings, servo: ServoLaw,
    known: SizeLaw,
) -> tuple[Sized | PlaySize, SizeLaw, ServoLaw]:  # fmt: skip
    """What one stretch tells, or why it tells nothing; and what is known after it."""
    if stretch.rate_hz < LEAST_RATE * settings.f_res_hz:
        return unknown(f"the sensor is too slow: {LEAST_RATE:g} samples a period of the bar are needed"), known, servo
    if not np.isfinite(stretch.accel).all():
        return unknown("samples are missing"), known, servo
    if servo.delay[1] > LEARNT:
        return unknown("how the servo follows is not known yet"), known, servo
    command = smoothed(times, commands, stretch)
    if command is None:
        return unknown("too few commands during the stretch"), known, servo
    apart, touched, offset = relative_motion(stretch, command, settings, servo, known.offset)
    known, solution = replace(known, offset=offset), solve(apart, touched)
    if not isinstance(solution, Solved):
        return solution, known, servo
    return sized(apart, solution), known, servo.corrected(lag_information(apart, solution))
