"""Packages that read and write the formats of others: imported when one is needed, else named with what
installs it."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import Any

from lostmotion.drivers.errors import RecordingError
from lostmotion.drivers.packages import missing

__all__ = ["needed"]


def needed(module: str, needs: Path | str) -> Any:
    """The module.  needs: the file to be read, or what else needs it.  Raises RecordingError with the line that
    installs its package."""
    try:
        return import_module(module)
    except ModuleNotFoundError as error:
        line = missing(error.name, needs if isinstance(needs, str) else f"{needs}: reading it")
        if line is None:
            raise
        raise RecordingError(line) from error
