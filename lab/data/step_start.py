"""The time before a recording that begins with a step of the input.

A logger is often started by the program that switches the motor on.  The filter of the band has a transient near the
ends of a recording, where no sample is compared, so that the acceleration, which is over in a tenth of a second, was
lost: of a motor with a time constant of 0.1 s that was recorded for a second the inertia was 0.6 % of the true one.
What was before is known: a shaft that begins to move at a constant input was at rest, and the input off.
"""

from __future__ import annotations

import logging
from dataclasses import replace

import numpy as np

from lostmotion.drivers.recording import Recording
from lostmotion.lab.data.series import resolution
from lostmotion.lab.data.stand_ins import is_sampled

__all__ = ["with_rest_before"]

FIRST = 0.02
"""Share of the way at the constant input by which it is judged whether the motion began at rest, and the least number
of steps of the sensor."""
LEAST_STEPS = 10
LEAST_ROWS = 6
"""Rows in which it makes this share of its way."""
FROM_REST = 0.375
"""Share of that way that is made in half of the time: 1/4 from rest, at a constant acceleration, and 1/2 at a constant
speed."""
BEFORE = 0.2
"""Duration of what is put before, as a share of the recording's: at least that near an end in which the filter has its
transient, 2 periods of the end of a band of 13.6 periods (signals.py)."""
log = logging.getLogger(__name__)


def with_rest_before(recording: Recording, column: str) -> Recording:
    """The recording with a rest, at which the input is zero, before its first row where the input is constant from
    there on and the shaft begins to move; column: of the input."""
    if not all(is_sampled(recording, name) for name in (column, "position")) or not _begins_with_step(
        recording, column
    ):
        return recording
    step = float(np.median(np.diff(recording.time)))
    count = int(BEFORE * recording.duration / step)
    time = recording.time[0] - step * np.arange(count, 0, -1)
    columns = {name: np.concatenate([np.full(count, np.nan), values]) for name, values in recording.columns.items()}
    columns[column][:count] = 0.0
    position = recording.columns["position"]
    columns["position"][:count] = position[~np.isnan(position)][0]
    log.warning(
        "%s: begins at rest, with a constant %s: it was switched on there, and is taken to have been off before",
        recording.name, column,
    )  # fmt: skip
    return replace(recording, time=np.concatenate([time, recording.time]), columns=columns, extra={})


def _begins_with_step(recording: Recording, column: str) -> bool:
    """Whether the input is constant from the first row on, not zero, and the motion begins at rest."""
    driving, position = recording.columns[column], recording.columns["position"]
    seen = ~np.isnan(driving) & ~np.isnan(position)
    driving, position, time = driving[seen], position[seen], recording.time[seen]
    if driving.size < LEAST_ROWS or driving[0] == 0:
        return False
    changes = np.flatnonzero(driving != driving[0])
    end = int(changes[0]) if changes.size else driving.size
    way = np.abs(position[:end] - position[0])
    first = max(FIRST * float(way.max()), LEAST_STEPS * resolution(position))
    reached = np.flatnonzero(way >= first)
    if not reached.size or reached[0] < LEAST_ROWS:
        return False
    at = int(reached[0])
    half = float(np.interp((time[0] + time[at]) / 2, time[:at], way[:at]))
    return half < FROM_REST * float(way[at])
