"""Angles without a unit beside a measured torque: in degrees where the weight of an arm says so.

A weight is a sine of the angle, so that its torque identifies the unit.  Beyond eight turns in rad no spring is there
that may look like a weight in degrees, and a motion in both directions distinguishes the angle from time.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lostmotion.drivers.recording import Recording
from lostmotion.lab.data.series import direction, rms
from lostmotion.lab.data.stand_ins import imported_columns
from lostmotion.model.effects.base import SHAFT_TURNS
from lostmotion.model.motion import FloatArray

if TYPE_CHECKING:
    from lostmotion.lab.data.experiment import Experiment

__all__ = ["in_degrees"]

DEGREE, TURN = math.pi / 180, 360.0
WINDOWS = (3, 41)
"""samples over which a speed is averaged, as its noise hides the acceleration in some.  One between them changes none
of the shares below by more than 0.01."""
EXPLAINS = 0.5
"""Share of what a fit in rad leaves, below which degrees are taken: 0.36 of an arm that is moved at -40 to 60 degrees a
second, and 0.99 to 2 of 50 published recordings of shafts that turn by more than eight turns."""
log = logging.getLogger(__name__)


class _Moved(NamedTuple):
    """Accelerations (M, 2), each smoothed over some samples, speed, angle and torque of samples (M,)."""

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


def in_degrees(experiments: Sequence[Experiment], recordings: Sequence[Recording]) -> Sequence[Experiment]:
    """The experiments of a joint, with angles in rad; a warning reports those that were found to be in degrees."""
    angles = [one.measured["position"] for one in experiments]
    are_known = not all("position_without_unit" in imported_columns(one) for one in recordings)
    if are_known or not angles or direction(angles) or not _may_be_degrees(np.concatenate(angles)):
        return experiments
    moved = [part for one in experiments if (part := _moved(one))]
    if len(moved) < len(experiments):
        return experiments
    every = _Moved(*map(np.concatenate, zip(*moved, strict=True)))
    rad, degrees = every.left(1.0), every.left(DEGREE)
    if not degrees < EXPLAINS * rad:
        return experiments
    log.warning(
        "%s: the angle is taken as deg, as the weight of an arm then explains the torque: as rad %.2g times as much of "
        "it would be left; else use --map 'position=%s:rad'",
        recordings[0].name, rad / degrees, imported_columns(recordings[0])["position"],
    )  # fmt: skip
    return [replace(one, measured={"position": DEGREE * one.measured["position"]}) for one in experiments]


def _may_be_degrees(angle: FloatArray) -> bool:
    """Whether numbers (N,) cover more than the turns of a spring or a weight in rad, and are at most a turn."""
    return bool(np.nanmax(angle) - np.nanmin(angle) >= math.tau * SHAFT_TURNS and np.nanmax(np.abs(angle)) <= TURN)


def _moved(experiment: Experiment) -> _Moved | None:
    """The samples of angle and torque; None where there is no torque, or too few samples."""
    seen = np.isfinite(experiment.measured["position"])
    time, angle = experiment.time[seen], experiment.measured["position"][seen]
    if experiment.drive is None or time.size < max(WINDOWS):
        return None
    speed = np.gradient(angle, time)
    smooth = [np.convolve(speed, np.ones(many) / many, "same") for many in WINDOWS]
    accelerations = np.stack([np.gradient(one, time) for one in smooth], axis=1)
    return _Moved(accelerations, speed, angle, np.asarray(experiment.drive.position(time)))
