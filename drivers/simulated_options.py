"""The options of a simulated robot: its joints, its accelerometers, and the robot as a whole."""

from __future__ import annotations

import math
from datetime import datetime
from typing import Annotated, Literal

import msgspec

from lostmotion.drivers.base import AccelerometerOptions, JointOptions, RobotOptions

__all__ = ["MOST_PLAY_M", "SimulatedAccelerometerOptions", "SimulatedJointOptions", "SimulatedOptions"]

NotNegative = Annotated[float, msgspec.Meta(ge=0)]
Positive = Annotated[float, msgspec.Meta(gt=0)]
MOST_PLAY_M = 1e-3
"""the largest gap between the teeth [m]; an AX-12A's is some 3e-5"""
MOST_SPEED = 1e7
"""times real time: a year in three seconds"""


class SimulatedJointOptions(JointOptions, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """play_m: the gap between the teeth at the start [m], 0 for none; wear_per_year: it grows as exp(wear_per_year t),
    t in years of operation, up to MOST_PLAY_M, for the larger the gap, the harder the teeth hit; resolution_rad: steps
    of command and position [rad], by default an AX-12A's 300°/1023; gear_radius_m: that of the model unless given."""

    play_m: Annotated[float, msgspec.Meta(ge=0, le=MOST_PLAY_M)] = 0.0
    wear_per_year: Annotated[float, msgspec.Meta(ge=0, le=100)] = 2.0
    resolution_rad: NotNegative = math.radians(300) / 1023
    gear_radius_m: Annotated[float, msgspec.Meta(gt=0, le=10)] | None = 0.010


class SimulatedAccelerometerOptions(AccelerometerOptions, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """noise_ms2: standard deviation [m/s²]; range_ms2 and resolution_ms2: by default of a 16-bit sensor for ±16 g."""

    noise_ms2: NotNegative = 0.1
    range_ms2: Positive = 156.9
    resolution_ms2: NotNegative = 0.0048


class SimulatedOptions(RobotOptions, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """speed: 1 is real time, 525600 a year in a minute, "max" as fast as it is read; start: UTC of robot time 0, by
    default now, or a year ago where time runs faster than real time; motion: as ``lostmotion simulate --motion`` takes
    it; seed: of motion and noise."""

    speed: Annotated[float, msgspec.Meta(gt=0, le=MOST_SPEED)] | Literal["max"] = 1.0
    start: datetime | None = None
    motion: str = "hand-waved"
    seed: Annotated[int, msgspec.Meta(ge=0)] = 0
