"""The phases of a modelled motion: before an impact, at it, after it; at rest; around a reversal."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from lostmotion.lab.data.series import rms
from lostmotion.model import Trajectory
from lostmotion.model.motion import FloatArray

__all__ = ["phases"]

CLOSED = 0.02
"""Share of the largest contact force above which the teeth count as in contact."""
REST = 0.03
"""Share of the usual speed below which the joint rests."""
IMPACT_S, BEFORE_S, AFTER_S = 0.008, 0.015, 0.06
"""Time after an impact that counts as at it, time before it, and time until which it is after it [s]."""
APART_S = 0.005
"""An event that follows another one sooner belongs to it [s]."""
REVERSAL_S, AROUND_S = 0.03, 0.1
"""Length of a reversal, and the time before it, and after it [s]."""
LARGE = 1.0
"""Deflections of the oscillator above so many times its root mean square are large."""

Mask = NDArray[np.bool_]


def phases(base: str, trajectory: Trajectory) -> Mapping[str, Mask]:
    """The samples in each phase of a modelled motion, as masks (N,); every sample is in exactly one.

    For gears the phases are around impacts, at which the modelled contact closes; for other joints around reversals of
    the speed; for an oscillator they are large and small deflections.
    """
    time = trajectory.time
    if base == "oscillator":
        q = np.abs(trajectory["displacement"])
        large = q > LARGE * rms(q)
        return {"at large deflection": large, "at small deflection": ~large}
    speed = np.abs(trajectory["velocity"])
    rest = speed < REST * rms(speed)
    if base == "play":
        force = np.abs(trajectory["force"])
        touching = force > CLOSED * force.max()
        events = _events(time, touching[1:] & ~touching[:-1])
        return _in_turn({
            "at an impact": _near(time, events, 0.0, IMPACT_S),
            "before an impact": _near(time, events, -BEFORE_S, 0.0),
            "after an impact": _near(time, events, IMPACT_S, AFTER_S),
            "at rest": rest,
            "in contact": touching,
            "in free flight": ~touching,
        })  # fmt: skip
    turned = np.sign(trajectory["velocity"])
    events = _events(time, turned[1:] * turned[:-1] < 0)
    moving = ~rest
    return _in_turn({
        "at a reversal": _near(time, events, -REVERSAL_S / 2, REVERSAL_S / 2),
        "at rest": rest,
        "before a reversal": _near(time, events, -AROUND_S, 0.0) & moving,
        "after a reversal": _near(time, events, 0.0, AROUND_S) & moving,
        "on the move": moving,
    })  # fmt: skip


def _events(time: FloatArray, edges: Mask) -> FloatArray:
    """The times [s] of the events at these edges (N - 1,), without those that follow another one at once."""
    found = time[1:][edges]
    apart = np.concatenate(([True], np.diff(found) > APART_S))[: found.size]
    return np.asarray(found[apart])


def _near(time: FloatArray, events: FloatArray, first: float, last: float) -> Mask:
    """The samples at times t with event + first <= t < event + last for some event."""
    return np.asarray(np.searchsorted(events + first, time, "right") > np.searchsorted(events + last, time, "right"))


def _in_turn(masks: Mapping[str, Mask]) -> dict[str, Mask]:
    """The masks with each sample in the first of its phases only, without empty ones."""
    taken = np.zeros(len(next(iter(masks.values()))), dtype=bool)
    found = {}
    for name, mask in masks.items():
        if np.any(mask & ~taken):
            found[name] = mask & ~taken
        taken |= mask
    return found
