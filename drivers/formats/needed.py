"""Packages that read the formats of others: imported when a file needs one, else named with what installs it."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import Any

from lostmotion.drivers.errors import RecordingError
from lostmotion.drivers.packages import missing

__all__ = ["needed"]


def needed(module: str, path: Path) -> Any:
    """The module.  Raises RecordingError with the line that installs its package."""
    try:
        return import_module(module)
    except ModuleNotFoundError as error:
        line = missing(error.name, f"{path}: reading it")
        if line is None:
            raise
        raise RecordingError(line) from error
