"""A whole recording at once: trigger, windows and scores, by the same functions as in the service."""

from __future__ import annotations

import math

import numpy as np

from lostmotion.detector.commanded import BEFORE_S
from lostmotion.detector.errors import DetectorError
from lostmotion.detector.flank import law_of
from lostmotion.detector.learner import settled
from lostmotion.detector.median import median
from lostmotion.detector.play_size import HISTORY_S, SizeLaw, learnt_play, near_part, segment_of
from lostmotion.detector.score import score_window, validate
from lostmotion.detector.servo import SPAN_S, UNKNOWN
from lostmotion.detector.severity import with_severity
from lostmotion.detector.trigger import Trigger
from lostmotion.detector.window import DetectorSettings, FloatArray, Score, Window
from lostmotion.detector.windows import cut, window_length

__all__ = ["rate_of", "score_series", "windows_of"]

NONSENSE_MS2 = 1e100
"""Readings from here on are invalid [m/s²]: no accelerometer reaches them, and their sums may overflow."""


def windows_of(
    times_servo: FloatArray,
    commands: FloatArray,
    times_accel: FloatArray,
    accel: FloatArray,
    settings: DetectorSettings,
    joint: str = "joint",
    resolution: float = math.nan,
) -> list[Window]:
    """One window for each reversal of the commanded acceleration, in time order; arguments and errors as below."""
    servo_rate, accel_rate = rate_of(times_servo, "commands"), rate_of(times_accel, "accelerations")
    validate(settings, accel_rate)
    duration = window_length(settings, accel_rate)
    accel = np.where(np.abs(accel) < NONSENSE_MS2, accel, np.nan)
    reversals = Trigger(settings, servo_rate, resolution).push(times_servo, commands)
    return [
        cut(joint, times_accel, accel, found.time, duration, accel_rate, excitation=abs(found.swing))
        for found in reversals
    ]


def score_series(
    times_servo: FloatArray,
    commands: FloatArray,
    times_accel: FloatArray,
    accel: FloatArray,
    settings: DetectorSettings,
    joint: str = "joint",
    resolution: float = math.nan,
    range_ms2: float = math.inf,
) -> list[Score]:
    """One Score for each reversal of the commanded acceleration, in time order.

    times_servo [s] and commands [rad], shape (N,); times_accel [s], ascending, and accel [m/s²], shape (M,): on one
    clock, at different rates.  resolution: quantisation of the commands [rad], 0 if none, NaN if unknown; range_ms2:
    the accelerometer's largest acceleration [m/s²].  Accelerations beyond 1e100 m/s² count as missing.  The noise is
    learnt from all windows before the first is scored, unless the settings give it.

    Raises DetectorError when there is too little data for a rate, or the settings do not fit the rate.
    """
    windows = windows_of(times_servo, commands, times_accel, accel, settings, joint, resolution)
    accel_rate = windows[0].rate_hz if windows else math.nan
    known = settled((window.accel for window in windows), windows[0].rate_hz, settings) if windows else settings
    scored = [score_window(window, known, range_ms2) for window in windows]
    around = [_around(score, times_servo, commands, times_accel, accel, accel_rate) for score in scored]
    servo, size_law, scores, law = UNKNOWN, SizeLaw(), [], law_of(settings)
    for score, (segment, polls, goals) in zip(scored, around, strict=True):
        servo = with_severity(score, near_part(score, segment), polls, goals, settings, servo)[1]
    for score, (segment, polls, goals) in zip(scored, around, strict=True):
        sized, law, size_law, servo = learnt_play(score, segment, polls, goals, settings, law, servo, size_law)
        scores.append(with_severity(sized, near_part(score, segment), polls, goals, settings, servo)[0])
    return scores


def _around(
    score: Score, times_servo: FloatArray, commands: FloatArray, times_accel: FloatArray, accel: FloatArray,
    rate_hz: float,
) -> tuple[Window, FloatArray, FloatArray]:  # fmt: skip
    """The segment of a score's window, and times and angles of the commands that moved the servo meanwhile."""
    segment = segment_of(score, times_accel, accel, rate_hz)
    first, last = times_servo.searchsorted((score.time - HISTORY_S - SPAN_S, score.time + score.duration + BEFORE_S))
    return segment, times_servo[first:last], commands[first:last]


def rate_of(times: FloatArray, what: str) -> float:
    """Samples a second, by the median of the intervals, without regard to gaps.

    Raises DetectorError for fewer than three samples or times that do not ascend.
    """
    steps = np.diff(times)
    if steps.size < 2:
        raise DetectorError(f"found {times.size} {what}, expected at least 3 to find their rate")
    period = median(steps)
    if not period > 0:
        raise DetectorError(
            f"the times of the {what} do not ascend (median step {period:g} s, from {times[0]:g} s on); "
            "is the file sorted, or are the times too large to be distinct?"
        )
    return 1 / period
