"""Which drivers there are: a table of our own, and the entry points of other packages.

A driver's module is imported only when the driver is asked for, so that a robot with one kind of servo does not carry
the others (nor the simulator's compiler) in memory.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

from lostmotion.drivers.base import Driver
from lostmotion.drivers.errors import UnknownDriverError

if TYPE_CHECKING:
    from importlib.metadata import EntryPoints

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
    return sorted({*BUILT_IN, *(point.name for point in _entry_points())})


def get_driver(name: str) -> Driver:
    """The driver of that name.  Raises UnknownDriverError, also when an installed plug-in cannot be imported."""
    if name in BUILT_IN:
        return _load(name, BUILT_IN[name])
    for point in _entry_points():
        if point.name == name:
            return _load(name, point.value)
    raise UnknownDriverError(f"no driver is called {name!r}; there are {', '.join(names())}")


def _entry_points() -> EntryPoints:
    from importlib.metadata import entry_points  # 3 MB that a robot with our own drivers does not need

    return entry_points(group=ENTRY_POINT_GROUP)


def _load(name: str, target: str) -> Driver:
    module, _, attribute = target.partition(":")
    try:
        driver = getattr(importlib.import_module(module), attribute)
    except (ImportError, AttributeError) as error:
        raise UnknownDriverError(f"driver {name!r} cannot be loaded from {target}: {error}") from error
    if not isinstance(driver, Driver):
        raise UnknownDriverError(f"driver {name!r}: {target} is no lostmotion.drivers.base.Driver")
    return driver
