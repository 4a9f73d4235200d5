"""Drives (CiA 402): the objects that are read, their units, and the states of a status word.

No I/O, no clock.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from lostmotion.drivers.codec.pdo import Object

__all__ = [
    "CURRENT",
    "DC_LINK",
    "DEMAND",
    "OPERATION_ENABLED",
    "POSITION",
    "PROFILE",
    "SIGNED",
    "STATUSWORD",
    "TARGET",
    "TORQUE",
    "VELOCITY",
    "Units",
    "state_of",
]

PROFILE = 402
STATUSWORD: Object = (0x6041, 0)
DEMAND: Object = (0x6062, 0)
POSITION: Object = (0x6064, 0)
VELOCITY: Object = (0x606C, 0)
TORQUE: Object = (0x6077, 0)
CURRENT: Object = (0x6078, 0)
DC_LINK: Object = (0x6079, 0)
TARGET: Object = (0x607A, 0)
SIGNED = (DEMAND, POSITION, VELOCITY, TORQUE, CURRENT, TARGET)
OPERATION_ENABLED = "operation enabled"
STATES: tuple[tuple[int, int, str], ...] = (
    (0x4F, 0x00, "not ready to switch on"),
    (0x4F, 0x40, "switch on disabled"),
    (0x6F, 0x21, "ready to switch on"),
    (0x6F, 0x23, "switched on"),
    (0x6F, 0x27, OPERATION_ENABLED),
    (0x6F, 0x07, "quick stop active"),
    (0x4F, 0x0F, "fault reaction active"),
    (0x4F, 0x08, "fault"),
)
"""mask and value of the status word, table 30 of CiA 402-2"""
PER_SECOND: Mapping[str, float] = MappingProxyType({"counts/s": 1.0, "rpm": 1 / 60})
"""units of velocity actual value in which drives are set up"""


def state_of(statusword: int) -> str:
    """The state of a drive by its status word."""
    for mask, value, name in STATES:
        if statusword & mask == value:
            return name
    return f"unknown (0x{statusword:04X})"


@dataclass(frozen=True, slots=True)
class Units:
    """What makes SI units of a drive's numbers.

    counts: of a turn of the motor; ratio: turns of the motor for one of the joint, negative where it turns the other
    way; velocity_unit: counts/s or rpm of the motor; rated_torque [N m] of the motor and rated_current [A], of which
    drives report thousandths, NaN where they are unknown.
    """

    counts: float
    ratio: float
    velocity_unit: str = "counts/s"
    rated_torque: float = math.nan
    rated_current: float = math.nan

    @property
    def step(self) -> float:
        """One count as an angle of the joint [rad]."""
        return math.tau / (self.counts * self.ratio)

    @property
    def speed(self) -> float:
        """One unit of velocity at the joint [rad/s]."""
        return self.step * (1.0 if self.velocity_unit == "counts/s" else self.counts * PER_SECOND[self.velocity_unit])

    @property
    def torque(self) -> float:
        """A thousandth of the rated torque at the joint [N m], friction left out."""
        return self.rated_torque * self.ratio / 1000

    @property
    def current(self) -> float:
        """A thousandth of the rated current [A]."""
        return self.rated_current / 1000
