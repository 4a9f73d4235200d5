"""Whether a Zenoh session has a link to its endpoints; a change is logged.  Nothing is sent here.

Publishing into a session whose router has died raises nothing: only the link to it is missing from the session's list.
A session that had no memory at that moment stays as it is, for ever: it keeps the router, and connects to none again.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable

import zenoh

from lostmotion.daemon.no_memory import retry_without_memory
from lostmotion.daemon.repeats import Condition
from lostmotion.daemon.zenoh_session import connect_endpoints, unreached

__all__ = ["LOOK_S", "LinkMonitor"]

log = logging.getLogger(__name__)

LOOK_S = 2.0
CLOSE_S = 2.0
BROKEN_LOOKS = 3
"""so many looks in a row see a router without a link to it: the session will never find out.  Of 20 routers that were
killed or stopped while there was memory each was seen so for 20 ms at most."""


class LinkMonitor:
    """Looks every two seconds, in a thread of its own, as long as there are endpoints.

    problem: why nothing arrives, "" while there is a link.  config: that of the session.

    broken: is called, once, for a session that has to be closed and opened again, with the time [s, monotonic] at which
    a link was last seen.
    """

    def __init__(self, session: zenoh.Session, config: zenoh.Config, broken: Callable[[float], None]) -> None:
        self._session, self._config, self._broken = session, config, broken
        endpoints = connect_endpoints(config)
        self._where = ", ".join(endpoints)
        self._condition = Condition(reported="")
        self.problem = f"nobody has answered at {self._where} yet" if endpoints else ""
        self._linked_at, self._without_link = time.monotonic(), 0
        self._closing = threading.Event()
        self._thread = threading.Thread(
            target=retry_without_memory, args=(self._look, "zenoh"), name="zenoh-links", daemon=True
        )
        if endpoints:
            self._thread.start()

    def close(self) -> None:
        """No look comes after this; the session may be closed then."""
        self._closing.set()
        if self._thread.ident is not None and self._thread is not threading.current_thread():
            self._thread.join(CLOSE_S)

    def _look(self) -> None:
        while not self._closing.wait(LOOK_S):
            try:
                is_linked, is_connected = self._seen()
            except zenoh.ZError:  # for lack of memory, too: the next look may succeed
                continue
            self._log_change(is_linked)
            if is_linked:
                self._linked_at = time.monotonic()
            self._without_link = self._without_link + 1 if is_connected and not is_linked else 0
            if self._without_link >= BROKEN_LOOKS:
                self._broken(self._linked_at)
                return

    def _seen(self) -> tuple[bool, bool]:
        """Whether there is a link, and whether the session believes that there is."""
        return bool(self._session.info.links()), bool(self._session.info.transports())

    def _log_change(self, is_linked: bool) -> None:
        if is_linked:
            self.problem = ""
        elif not self.problem:  # a look at the endpoints takes seconds, and connects to them
            self.problem = f"nobody answers at {unreached(self._config)}"
        if not self._condition.is_news("" if is_linked else "nobody", time.monotonic()):
            return
        if is_linked:
            log.info("zenoh: %s answers", self._where)
        else:
            log.warning("zenoh: %s; connecting is tried again, alarms are sent then", self.problem)
