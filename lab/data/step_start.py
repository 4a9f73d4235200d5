"""The time before a recording that begins with a step of the input.

A logger is often started by the program that switches the motor on.  The filter of the band has a transient near the
ends of a recording, where no sample is compared, so that the acceleration, which is over in a tenth of a second, was
lost: of nine published steps of a motor with a time constant of 0.1 s, a second each, the inertia was 0.6 % of the true
one, and the dry friction twice as large.
What was before is known: a shaft that begins to move at a constant input was at rest, and the input off.  Of a servo
that comes to goals which never change, at 1.5 rad/s at most, lag and friction were named instead of this limit.
"""

from __future__ import annotations

import logging
from dataclasses import replace

import numpy as np

from lostmotion.drivers.recording import Recording
from lostmotion.lab.data.series import resolution, seen
from lostmotion.lab.data.stand_ins import is_sampled
from lostmotion.model.motion import FloatArray

__all__ = ["with_rest_before"]

FIRST = 0.02
"""Share of the way at the constant input by which it is judged whether the motion began at rest, and the least number
of steps of the sensor."""
LEAST_STEPS = 10
LEAST_ROWS = 3
"""Rows after the first one of the way by which it is judged."""
FROM_REST = 0.375
"""Share of that way that is made in half of the time: 1/4 from rest, at a constant acceleration, and 1/2 at a constant
speed."""
BEFORE = 0.2
"""Duration of what is put before a joint's recording, as a share of its own: at least that near an end in which the
filter has its transient, 2 periods of the end of a band of 13.6 periods (signals.py)."""
log = logging.getLogger(__name__)


def with_rest_before(recording: Recording, column: str) -> Recording:
    """The recording with a rest before its first row, where the input is constant from there on and the part begins to
    move: a goal was that position, and another input zero.  column: of the input."""
    if not all(is_sampled(recording, name) for name in (column, "position")):
        return recording
    is_goal = column == "command"
    if not (_is_approached if is_goal else _is_driven)(*_at_constant_input(recording, column)):
        return recording
    step = float(np.median(np.diff(recording.time[~np.isnan(recording.columns["position"])])))
    if not step > 0:  # most times repeat the one before
        return recording
    # A servo's motion is compared at rest, too: more than one reading would count as measured, and lower the noise.
    count = 1 if is_goal else min(int(BEFORE * recording.duration / step), recording.time.size)  # rows may be in bursts
    time = recording.time[0] - step * np.arange(count, 0, -1)
    columns = {name: np.concatenate([np.full(count, np.nan), values]) for name, values in recording.columns.items()}
    first = float(seen(recording.columns["position"])[0])
    columns["position"][:count] = first
    columns[column][:count] = first if is_goal else 0.0
    log.warning(
        "%s: begins at rest, with a constant %s: %s", recording.name, column,
        "this goal was set there, and is taken to have been the position before" if is_goal
        else "it was switched on there, and is taken to have been off before",
    )  # fmt: skip
    return replace(recording, time=np.concatenate([time, recording.time]), columns=columns, extra={})


def _at_constant_input(recording: Recording, column: str) -> tuple[float, FloatArray, FloatArray]:
    """The first input, and the times [s] and positions (N,) up to where it changes; both need not be in one row."""
    driving, position = recording.columns[column], recording.columns["position"]
    known, read = ~np.isnan(driving), ~np.isnan(position)
    changed = recording.time[known][driving[known] != driving[known][0]]
    read &= recording.time <= np.append(changed, np.inf)[0]
    return float(driving[known][0]), recording.time[read], position[read]


def _is_driven(driving: float, time: FloatArray, position: FloatArray) -> bool:
    """Whether an input moves a part from rest."""
    return driving != 0 and _begins_at_rest(time, position)


def _is_approached(goal: float, time: FloatArray, position: FloatArray) -> bool:
    """Whether a servo comes from rest to a goal: more than half of the way, which is most of its motion.  One that is
    pulled to and fro does not."""
    if not _begins_at_rest(time, position):
        return False
    way, left = abs(position[0] - goal), abs(position[-1] - goal)
    return bool(2 * left < way and 1.5 * way > np.ptp(position))


def _begins_at_rest(time: FloatArray, position: FloatArray) -> bool:
    """Whether a part moves (N,), and begins at rest."""
    if position.size <= LEAST_ROWS:
        return False
    way = np.abs(position - position[0])
    first = max(FIRST * float(way.max()), LEAST_STEPS * resolution(position))
    reached = np.flatnonzero(way >= first) if first > 0 else np.empty(0, dtype=int)
    if not reached.size:
        return False
    at = max(int(reached[0]), LEAST_ROWS)
    half = float(np.interp((time[0] + time[at]) / 2, time[:at], way[:at]))
    return half < FROM_REST * float(way[at])
