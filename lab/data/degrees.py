"""Angles without a unit beside a measured torque: in degrees where the weight of an arm says so.

A weight is a sine of the angle, so that its torque identifies the unit.  Beyond eight turns in rad no spring is there
that may look like a weight in degrees, and a motion in both directions distinguishes the angle from time.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from lostmotion.drivers.recording import Recording
from lostmotion.lab.data.series import rms
from lostmotion.lab.data.stand_ins import imported_columns
from lostmotion.model.effects.base import SHAFT_TURNS
from lostmotion.model.motion import FloatArray

__all__ = ["in_degrees"]

DRIVES = ("torque", "current", "voltage")
DEGREE, TURN = math.pi / 180, 360.0
WINDOWS = (3, 11, 41)
"""samples over which a speed is averaged, as its noise hides the acceleration in some"""
LEAST_BACK = 0.1
"""share of the samples that move in either direction"""
EXPLAINS = 0.5
"""Share of what a fit in rad leaves, below which degrees are taken: 0.36 of an arm that is moved at -40 to 60 degrees a
second, and 0.99 to 2 of 50 published recordings of shafts that turn by more than eight turns."""
log = logging.getLogger(__name__)


class _Moved(NamedTuple):
    """Accelerations (M, 3), each smoothed over some samples, speed, angle and torque of samples (M,)."""

    accelerations: FloatArray
    speed: FloatArray
    angle: FloatArray
    torque: FloatArray

    def left(self, unit: float) -> float:
        """The root mean square of the torque that an inertia, friction, a constant and a weight leave, with this unit
        [rad]."""
        angle, speed = unit * self.angle, self.speed
        others = np.stack([speed, np.sign(speed), np.ones_like(speed), np.sin(angle), np.cos(angle)], axis=1)
        columns = np.concatenate([self.accelerations, others], axis=1)
        return rms(self.torque - columns @ np.linalg.lstsq(columns, self.torque, rcond=None)[0])


def in_degrees(recordings: Sequence[Recording]) -> Sequence[Recording]:
    """The recordings of a joint, with angles in rad; a warning reports those that were found to be in degrees."""
    moved = [part for one in recordings if (part := _moved(one))]
    if len(moved) < len(recordings) or not moved:
        return recordings
    every = _Moved(*map(np.concatenate, zip(*moved, strict=True)))
    is_back = min((every.speed > 0).mean(), (every.speed < 0).mean()) >= LEAST_BACK
    if not is_back or np.ptp(every.angle) < math.tau * SHAFT_TURNS or np.abs(every.angle).max() > TURN:
        return recordings
    rad, degrees = every.left(1.0), every.left(DEGREE)
    if degrees > EXPLAINS * rad:
        return recordings
    log.warning(
        "%s: the angle is taken as deg, as the weight of an arm then explains the torque: as rad %.2g times as much of "
        "it would be left; else use --map 'position=%s:rad'",
        recordings[0].name, rad / degrees, imported_columns(recordings[0])["position"],
    )  # fmt: skip
    return [replace(one, columns={**one.columns, "position": DEGREE * one.columns["position"]}) for one in recordings]


def _moved(recording: Recording) -> _Moved | None:
    """The samples of angle and torque; None where the unit of the angle is known, or there is no torque."""
    drive = next((name for name in DRIVES if name in recording.columns), "")
    if not drive or "position_without_unit" not in imported_columns(recording):
        return None
    angle, torque = recording.columns["position"], recording.columns[drive]
    seen = np.isfinite(angle) & np.isfinite(torque)
    time = recording.times(seen)
    new = np.diff(time, prepend=-np.inf) > 0
    time, angle, torque = time[new], angle[seen][new], torque[seen][new]
    if time.size < max(WINDOWS):
        return None
    speed = np.gradient(angle, time)
    smooth = [np.convolve(speed, np.ones(many) / many, "same") for many in WINDOWS]
    accelerations = np.stack([np.gradient(one, time) for one in smooth], axis=1)
    return _Moved(accelerations, speed, angle, torque)
