"""Which sinks there are: a table of our own, and the entry points of other packages.

A sink's module is imported when the service opens it: Zenoh takes 3 MB that many do without, python-can 8 MB.
"""

from __future__ import annotations

from collections.abc import Mapping

from lostmotion.daemon.options import CanOptions, SinkOptions, ZenohOptions
from lostmotion.daemon.sinks import Sink, SinkContext, SinkType
from lostmotion.drivers import plugins
from lostmotion.drivers.errors import LostmotionError

__all__ = ["ENTRY_POINT_GROUP", "SinkError", "get_sink", "names", "opened"]

ENTRY_POINT_GROUP = "lostmotion.sinks"


class SinkError(LostmotionError):
    """A sink is not installed, cannot be imported, or cannot be opened."""


def _zenoh(options: ZenohOptions, context: SinkContext) -> Sink:
    from lostmotion.daemon.sinks.zenoh import ZenohSink

    return ZenohSink(context.robot, options, context.database)


def _can(options: CanOptions, context: SinkContext) -> Sink:
    from lostmotion.daemon.sinks.can import CanSink

    return CanSink(context.joints, options)


BUILT_IN = {
    row.name: row
    for row in (
        SinkType("zenoh", "JSON under lostmotion/<robot>/, and ROS diagnostics", _zenoh, ZenohOptions, "zenoh"),
        SinkType("can", "emergency objects and states of a CANopen node", _can, CanOptions, "can"),
    )
}


def names() -> list[str]:
    """The names of all sinks that can be asked for."""
    return sorted({*BUILT_IN, *plugins.targets(ENTRY_POINT_GROUP)})


def get_sink(name: str) -> SinkType | None:
    """The sink of that name, None without.  Raises SinkError when an installed plug-in cannot be imported."""
    if name in BUILT_IN:
        return BUILT_IN[name]
    target = plugins.targets(ENTRY_POINT_GROUP).get(name)
    if target is None:
        return None
    try:
        return plugins.load(name, target, SinkType)
    except plugins.PluginError as error:
        raise SinkError(f"alarm.{name}: sink {error}") from error


def opened(sinks: Mapping[SinkType, SinkOptions], context: SinkContext) -> list[Sink]:
    """All of a configuration.  Raises SinkError when one of another package raises; those before it are closed."""
    found: list[Sink] = []
    for row, options in sinks.items():
        try:
            found.append(row.open(options, context))
        except Exception as error:
            for sink in found:
                sink.close()
            raise SinkError(f"alarm.{row.name}: the sink cannot be opened: {error!r}") from error
    return found
