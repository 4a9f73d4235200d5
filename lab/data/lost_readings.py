"""Readings of an angle that were lost: a bus that got no answer puts a zero, or the end of the range, in their place.

All of the lab's likelihoods suppose errors of the readings of about one size.  A joint cannot jump and come back
within a few samples: 11 of 9321 lost readings of a robot arm hid the viscous friction of its waist, and left a third of
the torque of other joints.  Nothing is fitted here.
"""

from __future__ import annotations

import logging
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from lostmotion.drivers.recording import Recording
from lostmotion.lab import policy
from lostmotion.model.motion import FloatArray

__all__ = ["lost_readings", "without_lost_readings"]

USUAL = 0.95
"""Quantile of the steps between two samples that stands for the motion: as many as 2 % of readings may be lost."""
MOST_LOST = 5
"""Consecutive readings; ``policy.LOST_JUMP`` has the measurement."""
TURN = 0.01
"""A jump this close to whole turns, in turns, is that of an angle that wraps."""
log = logging.getLogger(__name__)


def without_lost_readings(recording: Recording) -> Recording:
    """The recording with empty cells where readings of the angle were lost; what came with them is as unsure.  A
    warning says how many."""
    values = recording.columns["position"]
    seen = np.flatnonzero(~np.isnan(values))
    lost = seen[lost_readings(values[seen])]
    if not lost.size:
        return recording
    log.warning(
        "%s: %d of %d readings of position jump away and come back within %d samples, the first at %g s: left out",
        recording.name, lost.size, seen.size, MOST_LOST, recording.time[lost[0]],
    )  # fmt: skip
    blank = np.isin(np.arange(values.size), lost)
    columns = {name: np.where(blank, np.nan, samples) for name, samples in recording.columns.items()}
    return replace(recording, columns=columns)


def lost_readings(values: FloatArray) -> NDArray[np.bool_]:
    """Which values (N,) lie between two jumps, or between one and an end, and are ``MOST_LOST`` at most."""
    step, lost = np.abs(np.diff(values)), np.zeros(values.size, dtype=bool)
    if not step.any():
        return lost
    limit = policy.LOST_JUMP * max(float(np.quantile(step, USUAL)), float(step[step > 0].min()))
    turns = step / (2 * np.pi)
    jumps = np.flatnonzero((step > limit) & ~((turns > 0.5) & (np.abs(turns - np.round(turns)) < TURN)))
    ends = np.concatenate([[-1], jumps, [values.size - 1]])
    for first, last in zip(ends[:-1].tolist(), ends[1:].tolist(), strict=True):
        inner = first >= 0 and last + 1 < values.size
        back = not inner or abs(values[last + 1] - values[first]) <= limit
        if last - first <= MOST_LOST and back and jumps.size and not lost[max(first, 0)]:
            lost[first + 1 : last + 1] = True
    return lost
