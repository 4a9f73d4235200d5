"""Whether anybody answers where a Zenoh session connects to; told when that changes.  Nothing is sent here.

Publishing into a session whose router has died raises nothing: the router is only missing from the session's list.
"""

from __future__ import annotations

import json
import logging
import threading
import time
from contextlib import suppress

import zenoh

from lostmotion.daemon.no_memory import outlive
from lostmotion.daemon.repeats import Condition

__all__ = ["Reach", "addresses"]

log = logging.getLogger(__name__)

LOOK_S = 2.0
CLOSE_S = 2.0


def addresses(config: zenoh.Config) -> list[str]:
    """The endpoints that a session connects to, whatever its mode."""
    found = json.loads(config.get_json("connect/endpoints"))
    each = found.values() if isinstance(found, dict) else [found]
    return list(dict.fromkeys(str(endpoint) for some in each for endpoint in some or []))


class Reach:
    """Looks every two seconds, in a thread of its own, as long as there are endpoints."""

    def __init__(self, session: zenoh.Session, endpoints: list[str]) -> None:
        self._session, self._where = session, ", ".join(endpoints)
        self._condition = Condition(told="")
        self._closing = threading.Event()
        self._thread = threading.Thread(target=outlive, args=(self._look, "zenoh"), name="zenoh-reach", daemon=True)
        if endpoints:
            self._thread.start()

    def close(self) -> None:
        """No look comes after this; the session may be closed then."""
        self._closing.set()
        if self._thread.ident is not None:
            self._thread.join(CLOSE_S)

    def _look(self) -> None:
        with suppress(zenoh.ZError):  # the session is closed
            while not self._closing.wait(LOOK_S):
                info = self._session.info
                self._tell(bool(info.routers_zid() or info.peers_zid()))

    def _tell(self, is_reached: bool) -> None:
        if not self._condition.is_news("" if is_reached else "nobody", time.monotonic()):
            return
        if is_reached:
            log.info("zenoh: %s answers", self._where)
        else:
            log.warning("zenoh: nobody answers at %s; it is tried on, alarms wait until then", self._where)
