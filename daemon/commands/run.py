"""``lostmotion run``: the service in the foreground."""

from __future__ import annotations

from pathlib import Path

from lostmotion.daemon import service
from lostmotion.daemon.commands.where import find_config

__all__ = ["run"]


def run(given: Path | None, duration_s: float | None) -> int:
    """Runs until the time is over or a signal says so; the exit status is the service's."""
    return service.run(
        find_config(given), duration_s=duration_s, reload=(lambda: find_config(given)) if given else None
    )
