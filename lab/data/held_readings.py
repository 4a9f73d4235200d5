"""Readings that a log repeats until the next one comes: the samples of a slower sensor or bus on a faster clock.

All of the lab's likelihoods suppose that a reading belongs to its time.  A repeated one is late by up to the time for
which it is held: a staircase, whose speed is zero on the steps.  Its spectrum has images of the motion at multiples of
the true rate, far above its noise, which pass for motion: the band of a robot arm of 100 Hz logged at 1 kHz ended at
200 Hz, and the viscous friction of its joints was a third of what it is.  Nothing is fitted here.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from lostmotion.drivers.recording import Recording
from lostmotion.model.motion import FloatArray

__all__ = ["held_for", "without_held_readings"]

LEAST_CHANGES = 20
"""Changes of a column, by which its rate is judged."""
EVEN, STEPS = 0.8, 1.2
"""Least share of the changes of a column that come at even intervals, or with those of another one: 0.88 and 0.97 of a
camera's and an arm's held readings, 0.5 of a servo's current in steps.  Least ratio of the quartiles of its steps: 2.4
and more of seven held columns of 260 public tables, 1 of a slow motion in the steps of an encoder."""
log = logging.getLogger(__name__)


def without_held_readings(recording: Recording, outputs: Sequence[str], driver: str) -> Recording:
    """The recording with empty cells where readings of the outputs repeat the one before; those of the input too where
    it was held with them.  One that is held alone is what the input was: a command.  A warning says it."""
    columns, seen = dict(recording.columns), None
    for name in outputs:
        at = np.flatnonzero(~np.isnan(columns[name]))
        rows = held_for(columns[name][at])
        if rows == 1:
            continue
        new = at[_new(columns[name][at], rows)]
        log.warning(
            "%s: readings of %s are repeated until the next one comes, %d rows as a rule: the first of each is used",
            recording.name, name, rows,
        )  # fmt: skip
        columns[name] = _only(columns[name], new)
        seen = new if seen is None else seen
    if seen is not None and driver in columns and _changes_with(columns[driver], seen):
        columns[driver] = _only(columns[driver], seen)
    return replace(recording, columns=columns)


def held_for(values: FloatArray) -> int:
    """The number of samples for which each value (N,) is held; 1 where they are not.

    Held readings change at even intervals, by steps of all sizes.  Those of a slow motion in the steps of an encoder
    repeat, too, but change by one size.
    """
    at = np.flatnonzero(np.diff(values))
    if at.size < LEAST_CHANGES:
        return 1
    gaps, steps = np.diff(at), np.abs(np.diff(values)[at])
    usual = int(np.median(gaps))
    low, high = np.quantile(steps, (0.25, 0.75))
    is_even = np.mean(np.abs(gaps - usual) <= max(usual // 4, 1)) >= EVEN
    return usual if usual > 1 and is_even and high > STEPS * low else 1


def _new(values: FloatArray, rows: int) -> NDArray[np.intp]:
    """The samples that are readings: the first, each change, and where nothing changes one in so many rows."""
    found = [0]
    for at in [*(np.flatnonzero(np.diff(values)) + 1).tolist(), values.size]:
        found += range(found[-1] + rows, at - rows // 2, rows)
        found += [at] if at < values.size else []
    return np.array(found)


def _only(values: FloatArray, rows: NDArray[np.intp]) -> FloatArray:
    """The column with empty cells everywhere but in these rows."""
    kept = np.full_like(values, np.nan)
    kept[rows] = values[rows]
    return kept


def _changes_with(values: FloatArray, rows: NDArray[np.intp]) -> bool:
    """Whether a column changes in these rows only, as a rule."""
    changes = np.flatnonzero(np.diff(values)) + 1
    return changes.size > 0 and float(np.mean(np.isin(changes, rows))) >= EVEN
