"""``lostmotion run``: the service in the foreground."""

from __future__ import annotations

from pathlib import Path

from lostmotion.daemon import config, heap, service

__all__ = ["run"]


def run(given: Path | None, duration_s: float | None) -> int:
    """Runs until the time is over or a signal comes; the exit status is the service's."""
    heap.set_up()
    if given is None:
        return service.run(config.default(), duration_s=duration_s)
    return service.run(config.load(given), duration_s=duration_s, reload=lambda: config.load(given))
