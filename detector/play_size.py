"""The size of the play from one reversal: the joint's motion from the bar's ring, the gear's from the command.

Inverting eq. 7 gives the impulses on the joint from the acceleration of the bar's tip; it holds for any force on the
joint, also the bar's reaction.  The impulses' second integral is the joint's angle theta_2, up to a constant speed and
angle, so D = theta_2 - theta_1 is known except for a + b t, with the covariance of impulses and command.  Where the
joint touches a flank (``contacts``: at an impact or a rest) and is accelerated in the direction s,

    D(t_k) = a + b t_k - s_k X_k phi / 2,    X = (|theta_2''| / A)^(1/n),

of which a, b and the play phi are found by generalised least squares; elsewhere D is between the flanks.  The fit gives
D between the contacts; contacts that contradict it are removed, and rests are extended to the end of the command's
acceleration, until nothing changes.  X is eq. 1's, see ``flank``.  Friction, restitution and the order of bounces are
not needed.  docs/decisions/0007-play-size.md has the measurements.  No trigger, no trend.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from lostmotion.detector.commanded import BEFORE_S, NO_CONTACTS, SmoothnessEvidence, alternatives
from lostmotion.detector.contact_fit import Solved, lag_information, likelier_otherwise, size_estimate, solve
from lostmotion.detector.flank import FlankLaw, SizeEstimate, law_of
from lostmotion.detector.offset import OFFSET_UNKNOWN, OffsetLaw
from lostmotion.detector.pooling import NO_EVIDENCE, PlayEvidence, PlaySize, Z, unknown
from lostmotion.detector.relative_motion import relative_motion
from lostmotion.detector.servo import AT_ONCE, ServoLaw
from lostmotion.detector.window import DetectorSettings, FloatArray, Score, Window
from lostmotion.detector.windows import cut, last_part

__all__ = ["HISTORY_S", "SizeLaw", "learnt_play", "near_part", "play_size", "segment_of", "with_play"]

HISTORY_S = 0.6
"""A segment begins so long before the reversal [s], so that it contains several crossings of the gap.  With 0.2, 0.4
and 0.6 s 65, 76 and 81 % of the windows above 30 dB gave a size, and 95.6, 94.4 and 94.1 % of the intervals held (52
joints of ``bench.outside``, seeds 3000 to 3059)."""
LEAST_RATE = 8.0
"""Samples a period of the bar: with fewer, impulses cannot be separated."""
LEARNT = 0.025
"""Standard deviation of the servo's delay [s] above which no size is estimated: after some five windows it is less.  It
is in the interval; 0.015 gives the same 1446 sizes of 1813 windows that lag (``bench.outside``, seeds 7000 to 7119)."""


@dataclass(frozen=True, slots=True)
class SizeLaw:
    """The estimates from a joint's earlier windows: its sensor's offset, the evidence of play and that of commands
    without corners."""

    offset: OffsetLaw = OFFSET_UNKNOWN
    evidence: PlayEvidence = NO_EVIDENCE
    smoothness: SmoothnessEvidence = NO_CONTACTS


NOTHING_KNOWN = SizeLaw()
"""Before the first window."""


def play_size(
    segment: Window, servo_times: Sequence[float] | FloatArray, commands: Sequence[float] | FloatArray,
    settings: DetectorSettings, law: FlankLaw | None = None, servo: ServoLaw = AT_ONCE,
) -> PlaySize:  # fmt: skip
    """The play from one segment of tip acceleration, from some time before a reversal to the window's end.

    servo_times [s] and commands [rad], shape (M,): the commands during the segment and shortly before; segment: without
    missing samples; law: the flanks as estimated from earlier windows; servo: likewise its response to the commands.
    """
    estimate = _estimate(segment, np.asarray(servo_times), np.asarray(commands), settings, servo, NOTHING_KNOWN)[0]
    if isinstance(estimate, PlaySize):
        return estimate
    return _under(estimate, law or law_of(settings), _evidence(estimate, NO_EVIDENCE))


def segment_of(score: Score, times: FloatArray, accel: FloatArray, rate_hz: float) -> Window:
    """The segment from which the play of a score's window is estimated, cut from a stream of tip acceleration."""
    return cut(score.joint, times, accel, score.time - HISTORY_S, score.duration + HISTORY_S, rate_hz)


def near_part(score: Score, segment: Window) -> Window:
    """The part of a segment from which the severity is estimated: from ``BEFORE_S`` before the reversal on."""
    return last_part(segment, score.duration + BEFORE_S)


def with_play(
    score: Score, segment: Window, servo_times: Sequence[float] | FloatArray, commands: Sequence[float] | FloatArray,
    settings: DetectorSettings,
) -> Score:  # fmt: skip
    """The score with the play estimated from its segment alone, or the reason why there is no estimate."""
    return learnt_play(score, segment, servo_times, commands, settings, law_of(settings))[0]


def learnt_play(
    score: Score, segment: Window, servo_times: Sequence[float] | FloatArray, commands: Sequence[float] | FloatArray,
    settings: DetectorSettings, law: FlankLaw, servo: ServoLaw = AT_ONCE, known: SizeLaw = NOTHING_KNOWN,
) -> tuple[Score, FlankLaw, SizeLaw, ServoLaw]:  # fmt: skip
    """The score with the play estimated from its segment and the earlier estimates of flanks, servo and offset; then
    these estimates, updated by this window."""
    if not settings.play_size or not score.impact or "clipped" in score.quality:
        reason = "not asked for" if not settings.play_size else "clipped" if score.impact else "no impact"
        return replace(score, play_reason=reason), law, known, servo
    times = np.asarray(servo_times)
    if not np.isfinite(segment.accel).all() or not times.size or times[0] > segment.start:
        segment = near_part(score, segment)
    estimate, known, servo = _estimate(segment, times, np.asarray(commands), settings, servo, known)
    if isinstance(estimate, SizeEstimate):
        law = law.updated(estimate)
        known = replace(known, evidence=_evidence(estimate, known.evidence))
        estimate = _under(estimate, law, known.evidence)
    score = replace(
        score, play=estimate.value, play_low=estimate.low, play_high=estimate.high, play_reason=estimate.reason
    )
    return score, law, known, servo


def _evidence(estimate: SizeEstimate, evidence: PlayEvidence) -> PlayEvidence:
    """The evidence after one more window, with the softness at which the play is least significant: a response in
    proportion to the acceleration, without play, looks like soft teeth."""
    least = int(np.argmin(estimate.play / estimate.deviation))
    return evidence.updated(float(estimate.play[least]), float(estimate.deviation[least]))


def _under(estimate: SizeEstimate, law: FlankLaw, evidence: PlayEvidence) -> PlaySize:
    """The play under a law of the flanks; unknown where all windows together are no evidence of play."""
    if not evidence.is_significant:
        return unknown("the play is lost in its own uncertainty")
    return PlaySize(*law.interval(estimate, Z))


def _estimate(
    segment: Window, times: FloatArray, commands: FloatArray, settings: DetectorSettings, servo: ServoLaw,
    known: SizeLaw,
) -> tuple[SizeEstimate | PlaySize, SizeLaw, ServoLaw]:  # fmt: skip
    """The estimate from one segment, or the reason why there is none; then the updated offset, evidence and servo."""
    if segment.rate_hz < LEAST_RATE * settings.f_res_hz:
        return unknown(f"the sensor is too slow: {LEAST_RATE:g} samples a period of the bar are needed"), known, servo
    if not np.isfinite(segment.accel).all():
        return unknown("samples are missing"), known, servo
    if servo.delay[1] > LEARNT:
        return unknown("how the servo follows is not known yet"), known, servo
    both = alternatives(times, commands, segment)
    if both is None:
        return unknown("too few commands in the interval"), known, servo
    is_smooth = known.smoothness.is_smooth
    used, other = both if is_smooth else both[::-1]
    relative, touched, offset = relative_motion(segment, used, other, settings, servo, known.offset)
    known, solution = replace(known, offset=offset), solve(relative, touched)
    if not isinstance(solution, Solved):
        return solution, known, servo
    if relative.alternative is not None:
        gain = likelier_otherwise(relative, solution)
        known = replace(known, smoothness=known.smoothness.updated(-gain if is_smooth else gain))
    return size_estimate(relative, solution), known, servo.corrected(lag_information(relative, solution))
