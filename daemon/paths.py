"""Paths that a configuration names, and the folder of a user's state."""

from __future__ import annotations

import os
from pathlib import Path

from lostmotion.drivers.errors import LostmotionError

__all__ = ["PathError", "expanded", "state_folder"]


class PathError(LostmotionError):
    """A path begins with the home of a user who has none."""


def expanded(key: str, given: str) -> Path:
    """The path that a key of the configuration gives; ``~`` is the home.  Raises PathError."""
    try:
        return Path(given).expanduser()
    except RuntimeError as error:
        raise PathError(f"{key}: found {given!r}, expected a path; that user has no home folder") from error


def state_folder() -> Path:
    """Where this user's programs keep what should survive a restart (XDG base directory specification, by which a
    relative path counts as none).  Raises PathError."""
    given = Path(os.environ.get("XDG_STATE_HOME", ""))
    try:
        return (given if given.is_absolute() else Path.home() / ".local" / "state") / "lostmotion"
    except RuntimeError as error:
        raise PathError(
            "store.path: found none, and no home folder of this user for the default; set HOME, or give store.path"
        ) from error
