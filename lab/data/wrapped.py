"""Angles that begin anew: after a turn, as encoders and ``atan2`` do, or where a counter is full.  Nothing is fitted
here."""

from __future__ import annotations

import logging
from dataclasses import replace

import numpy as np

from lostmotion.drivers.recording import Recording
from lostmotion.model.motion import FloatArray

__all__ = ["turned_on", "without_wraps"]

ANGLES = ("position", "command")
TURN = 2 * np.pi
WHOLE, BESIDE = 0.8, 0.2
"""Shares of the range: the least jump of an angle that begins anew, and the largest step beside such jumps."""
NEAR = 3
"""samples before and after a jump, which go on in the same direction"""
OFF = 0.02
"""of a turn: how far a jump may be from one"""
log = logging.getLogger(__name__)


def without_wraps(recording: Recording) -> Recording:
    """The recording with angles that turn on where they began anew.  A warning says how often."""
    columns = dict(recording.columns)
    for name in ANGLES:
        values = columns.get(name, np.empty(0))
        seen = np.flatnonzero(~np.isnan(values))
        found = turned_on(values[seen])
        if found is not None:
            columns[name] = np.array(values)
            columns[name][seen] = found
            added = np.abs(np.diff(found - values[seen]))
            log.warning(
                "%s: %s begins anew %d times, after %.4g rad each: it is taken to turn on", recording.name, name,
                np.count_nonzero(added > added.max() / 2), added.max(),
            )  # fmt: skip
    return replace(recording, columns=columns)


def turned_on(values: FloatArray) -> FloatArray | None:
    """The angle (N,) without its jumps by one size, a turn or the range of a counter; None where it has none.

    What begins anew goes on in the direction from which it came, against the jump; a servo that jumps between two goals
    faster than it is read rests before and after.  Near a turn the readings of a shaft at rest may jump, too.
    """
    steps = np.diff(values)
    size = np.abs(steps)
    jumps = np.flatnonzero(size > WHOLE * np.ptp(values)) if values.size > 2 * NEAR else np.empty(0, dtype=int)
    others = np.delete(size, jumps)
    if not jumps.size or not others.size or others.max() > BESIDE * np.ptp(values):
        return None
    around = [np.r_[steps[max(at - NEAR, 0) : at], steps[at + 1 : at + 1 + NEAR]] for at in jumps]
    onward = np.array([np.median(near[np.abs(near) <= others.max()]) if near.size else 0.0 for near in around])
    ranges = np.abs(steps[jumps] - onward)
    whole = float(np.median(ranges))
    is_turn = abs(whole - TURN) < OFF * TURN
    if np.abs(ranges - whole).max() > BESIDE * whole or not (is_turn or (onward * steps[jumps] < 0).all()):
        return None
    return np.unwrap(values, period=TURN if is_turn else whole)
