"""``lostmotion run``: the service in the foreground."""

from __future__ import annotations

import sys
from pathlib import Path

from lostmotion.daemon import config as configuration
from lostmotion.daemon import service
from lostmotion.daemon.commands.where import find_config

__all__ = ["run"]


def run(given: Path | None, duration_s: float | None) -> int:
    """Runs until the time is over or a signal says so; the exit status is the service's."""
    config = find_config(given)
    robot = f"robot {config.robot.name}" if given else "no --config, so a simulated robot"
    sys.stderr.write(f"{robot}; database {config.database}\n")
    return service.run(config, duration_s=duration_s, reload=(lambda: configuration.load(given)) if given else None)
