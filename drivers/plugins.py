"""Rows of a table that other packages add by entry points."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, TypeVar

from lostmotion.drivers.errors import LostmotionError

if TYPE_CHECKING:
    from importlib.metadata import EntryPoints

__all__ = ["PluginError", "load", "targets"]

T = TypeVar("T")


class PluginError(LostmotionError):
    """What a package names in its entry point cannot be loaded, or is something else."""


def targets(group: str) -> dict[str, str]:
    """What the installed packages name in a group of entry points: ``module:attribute`` by name."""
    return {point.name: point.value for point in _entry_points(group)}


def load(name: str, target: str, kind: type[T]) -> T:
    """The object at ``module:attribute``.  Raises PluginError, also when its module cannot be imported."""
    module, _, attribute = target.partition(":")
    try:
        row = getattr(importlib.import_module(module), attribute)
    except (ImportError, AttributeError) as error:
        raise PluginError(f"{name!r} cannot be loaded from {target}: {error}") from error
    if not isinstance(row, kind):
        raise PluginError(f"{name!r}: {target} is no {kind.__module__}.{kind.__qualname__}")
    return row


def _entry_points(group: str) -> EntryPoints:
    from importlib.metadata import entry_points  # 3 MB that a robot with our own drivers does not need

    return entry_points(group=group)
