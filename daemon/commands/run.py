"""``lostmotion run``: the service in the foreground."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from lostmotion.daemon import service
from lostmotion.daemon.commands.where import find_config
from lostmotion.daemon.config import Config

__all__ = ["run"]


def run(given: Path | None, duration_s: float | None) -> int:
    """Runs until the time is over or a signal says so; the exit status is the service's.

    Which robot runs and where its database lies is the first note of the configuration: the service tells notes when
    all has opened, so that a start that fails is the error's one line.
    """

    def load() -> Config:
        config = find_config(given)
        robot = f"robot {config.robot.name}" if given else "no --config, so a simulated robot"
        return replace(config, notes=(f"{robot}; database {config.database}", *config.notes))

    return service.run(load(), duration_s=duration_s, reload=load if given else None)
