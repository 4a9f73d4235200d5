"""The interfaces to devices: what a driver is, its options, and the values it returns.

A driver turns a device's bytes into SI values with robot times.  It has four methods: ``open``, ``identify``,
``read`` and ``close``.  It does not score, store or retry: the service does.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Protocol

import msgspec
import numpy as np
from numpy.typing import NDArray

from lostmotion.drivers.clock import Clock

__all__ = [
    "BITS_PER_BYTE",
    "AccelBlock",
    "Accelerometer",
    "AccelerometerOptions",
    "Baudrate",
    "Driver",
    "FloatArray",
    "Identity",
    "JointOptions",
    "OscillatorOptions",
    "Port",
    "RobotOptions",
    "ServoBus",
    "ServoReading",
    "ServoSample",
]

FloatArray = NDArray[np.float64]

Port = Annotated[str, msgspec.Meta(min_length=1)]
"""``port`` of a driver that cannot do without"""
Baudrate = Annotated[int, msgspec.Meta(gt=0)]
BITS_PER_BYTE = 10
"""on a serial line: a start bit, eight of data, a stop bit"""


class ServoSample(msgspec.Struct, frozen=True, gc=False):
    """The state of one joint at one instant; what the servo does not report is NaN.

    No dataclass: hundreds come in a second, and that takes twenty times as long to make.

    time: robot time [s]; command: the commanded angle [rad]; position: the measured angle of the output [rad];
    velocity [rad/s]; torque [N m]; current [A]; voltage [V]; temperature [°C].
    """

    joint: str
    time: float
    command: float
    position: float
    velocity: float = math.nan
    torque: float = math.nan
    current: float = math.nan
    voltage: float = math.nan
    temperature: float = math.nan


@dataclass(frozen=True, slots=True)
class ServoReading:
    """What one ``read`` brought: samples in time order, and the joints that should have answered and did not."""

    samples: tuple[ServoSample, ...] = ()
    silent: tuple[str, ...] = ()
    lost: int = 0
    """polls that were skipped because the bus was too slow, since the last reading"""
    broken: int = 0
    """frames thrown away for a wrong checksum or form, since the last reading"""


@dataclass(frozen=True, slots=True)
class AccelBlock:
    """Consecutive samples of an accelerometer.

    time: robot times [s], ascending, shape (N,); accel: tangential tip acceleration [m/s²], shape (N,), NaN where a
    sample is known to be lost or broken; lost and late: how many samples of this block's stretch were lost, or came
    later than the sensor's period allows; broken: frames thrown away for a wrong checksum or form.
    """

    time: FloatArray
    accel: FloatArray
    lost: int = 0
    late: int = 0
    broken: int = 0


@dataclass(frozen=True, slots=True)
class Identity:
    """One device as it answered: what was found, what was expected, and whether that is the same.

    gist: found, without what differs between looks, such as received bytes: the reason of an alarm, which is raised
    again when it changes; "" where found is always the same.
    """

    name: str
    found: str
    expected: str
    ok: bool
    gist: str = ""


class OscillatorOptions(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The metal bar under an accelerometer: resonance [Hz], damping ratio [-], length [m]."""

    f_res_hz: float
    zeta: float = 0.012
    length_m: float = 0.10


class JointOptions(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What every ``[[joint]]`` table has; a driver adds its own keys in a subclass.

    levers_m: how far the joint's axis is from the accelerometers that feel it [m], by their names, negative where the
    joint turns the other way round; its own accelerometer's, unless given, is the length of the bar.  gear_radius_m: of
    the joint's last gear [m], where play is also to be given as the gap between its teeth.
    """

    name: str
    driver: str
    port: str = ""
    poll_hz: float = 100.0
    accelerometer: str
    levers_m: dict[str, float] = {}
    gear_radius_m: Annotated[float, msgspec.Meta(gt=0, le=10)] | None = None

    def line_bytes(self) -> int:
        """Bytes that a poll puts on a serial line of so many baud, at least; 0 where there is no such line."""
        return 0


class AccelerometerOptions(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What every ``[[accelerometer]]`` table has; a driver adds its own keys in a subclass."""

    name: str
    driver: str
    port: str = ""
    rate_hz: float
    oscillator: OscillatorOptions

    def line_bytes(self) -> int:
        """Bytes that a reading puts on a serial line of so many baud, at least; 0 where there is no such line."""
        return 0


class RobotOptions(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A driver's settings that belong to no single joint or sensor: the top-level table of the driver's name
    (``[simulated]``, ``[replay]``).  A driver without such settings uses this empty one."""


class ServoBus(Protocol):
    """All joints of one driver on one port.

    ``read`` paces itself: it blocks until there is something new, at most about 0.3 s, and may then return nothing.
    ``resolution_rad`` is the step in which the command is quantised [rad], 0 where it is continuous, NaN if unknown.
    """

    resolution_rad: float

    def open(self) -> None:
        """Takes the port.  Raises PortError."""
        ...

    def identify(self) -> tuple[Identity, ...]:
        """Asks every device who it is.  Raises PortError; a wrong or silent device is described in its Identity."""
        ...

    def read(self) -> ServoReading:
        """The samples since the last call.  Raises PortError when the port is gone, EndOfData at a replay's end."""
        ...

    def close(self) -> None:
        """Gives the port back; may be called at any time, and twice."""
        ...


class Accelerometer(Protocol):
    """One accelerometer on one port; ``read`` paces itself as a bus's does.

    ``range_ms2`` is the largest acceleration it can show [m/s²], inf if unknown: samples there are clipped.
    """

    range_ms2: float

    def open(self) -> None:
        """Takes the port.  Raises PortError."""
        ...

    def identify(self) -> tuple[Identity, ...]:
        """Listens until the device has shown that it speaks this protocol at this rate.  Raises PortError."""
        ...

    def read(self) -> AccelBlock:
        """The samples since the last call.  Raises PortError when the port is gone, EndOfData at a replay's end."""
        ...

    def close(self) -> None:
        """Gives the port back; may be called at any time, and twice."""
        ...


class ServoFactory(Protocol):
    """Makes the bus for all joints that share a driver and a port; does not open it."""

    def __call__(self, joints: Sequence[JointOptions], robot: RobotOptions, clock: Clock) -> ServoBus: ...


class AccelerometerFactory(Protocol):
    """Makes one accelerometer; does not open it."""

    def __call__(self, options: AccelerometerOptions, robot: RobotOptions, clock: Clock) -> Accelerometer: ...


class ClockFactory(Protocol):
    """Makes the clock of a robot with virtual time."""

    def __call__(self, robot: RobotOptions) -> Clock: ...


class RobotCheck(Protocol):
    """Looks at the options of the driver's own table without opening anything.  Raises DriverError."""

    def __call__(self, robot: RobotOptions) -> None: ...


@dataclass(frozen=True, slots=True)
class Driver:
    """One row of the driver table.

    A driver offers a servo bus, an accelerometer or both.  ``clock`` is None for the outside world (the system's
    clock); a virtual robot brings its own, is never ahead of its reader (``waits``: the service may let it wait), and
    shares nothing with hardware.  ``check`` reports errors in the driver's own table beyond its types.
    ``shares``: its port is a bus on which joints and accelerometers of several such drivers may listen.
    """

    name: str
    summary: str
    servo: ServoFactory | None = None
    accelerometer: AccelerometerFactory | None = None
    joint_options: type[JointOptions] = JointOptions
    accelerometer_options: type[AccelerometerOptions] = AccelerometerOptions
    robot_options: type[RobotOptions] = RobotOptions
    clock: ClockFactory | None = None
    check: RobotCheck | None = None
    shares: bool = False

    @property
    def waits(self) -> bool:
        """Whether its data can wait for a slow reader (virtual time) instead of being lost."""
        return self.clock is not None
