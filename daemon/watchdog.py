"""When the service sends keep-alives to systemd: while samples arrive and no poller hangs."""

from __future__ import annotations

import logging
import time

from lostmotion.daemon.notify import Notifier
from lostmotion.daemon.robot import Robot

__all__ = ["Watchdog"]

log = logging.getLogger(__name__)


class Watchdog:
    """systemd restarts a service that sends no keep-alive for a period."""

    def __init__(self, notifier: Notifier) -> None:
        self._notifier = notifier
        self._last, self._samples = time.monotonic(), 0

    def feed(self, robot: Robot) -> None:
        """Sends a keep-alive, three in a period, unless a poller hangs or nothing arrives; one missing device does not
        count."""
        now, period_s = time.monotonic(), self._notifier.watchdog_s
        if not period_s or now - self._last < period_s / 3:
            return
        before, self._last, self._samples = self._samples, now, robot.samples
        if hung := robot.hung(period_s):
            log.error("%s: no sign of life for %g s; the watchdog is not fed", ", ".join(hung), period_s)
        elif robot.samples != before:
            self._notifier.watchdog()
