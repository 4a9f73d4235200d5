"""Which drivers there are: a table of our own, and the entry points of other packages.

A driver's module is imported only when the driver is asked for, so that a robot with one kind of servo does not carry
the others (nor the simulator's compiler) in memory.
"""

from __future__ import annotations

from lostmotion.drivers import plugins
from lostmotion.drivers.base import Driver
from lostmotion.drivers.errors import UnknownDriverError

__all__ = ["ENTRY_POINT_GROUP", "get_driver", "names"]

ENTRY_POINT_GROUP = "lostmotion.drivers"

BUILT_IN = {
    "can": "lostmotion.drivers.can_signal:DRIVER",
    "canopen": "lostmotion.drivers.canopen:DRIVER",
    "csv_serial": "lostmotion.drivers.csv_serial:DRIVER",
    "dynamixel": "lostmotion.drivers.dynamixel:DRIVER",
    "feetech": "lostmotion.drivers.feetech:DRIVER",
    "iio": "lostmotion.drivers.iio:DRIVER",
    "replay": "lostmotion.drivers.replay:DRIVER",
    "ros2": "lostmotion.drivers.ros2:DRIVER",
    "simulated": "lostmotion.drivers.simulated:DRIVER",
    "tap": "lostmotion.drivers.tap:DRIVER",
    "witmotion": "lostmotion.drivers.witmotion:DRIVER",
}


def names() -> list[str]:
    """The names of all drivers that can be asked for."""
    return sorted({*BUILT_IN, *plugins.targets(ENTRY_POINT_GROUP)})


def get_driver(name: str) -> Driver:
    """The driver of that name.  Raises UnknownDriverError, also when an installed plug-in cannot be imported."""
    target = BUILT_IN.get(name) or plugins.targets(ENTRY_POINT_GROUP).get(name)
    if target is None:
        raise UnknownDriverError(f"no driver is called {name!r}; there are {', '.join(names())}")
    try:
        return plugins.load(name, target, Driver)
    except plugins.PluginError as error:
        raise UnknownDriverError(f"driver {error}") from error
