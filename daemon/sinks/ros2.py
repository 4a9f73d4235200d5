"""A thread that sends a robot's diagnostics to ROS 2 once a second, over a Zenoh session that is open."""

from __future__ import annotations

import hashlib
import threading
import time
from collections.abc import Callable
from datetime import UTC, datetime

import zenoh

from lostmotion.daemon.no_memory import retry_without_memory
from lostmotion.daemon.sinks.diagnostics import Board, key, tokens
from lostmotion.drivers.codec.rmw_zenoh import GID_BYTES, attachment

__all__ = ["Ros2Publisher"]

PERIOD_S = 1.0
"""the habit of ROS: an aggregator calls what is silent for five seconds stale [s]"""
CLOSE_S = 2.0


class Ros2Publisher:
    """Shows a node and a publisher to ROS, and sends the board's messages; report: gets the error, "" for none."""

    def __init__(
        self, session: zenoh.Session, robot: str, domain: int, board: Board, report: Callable[[str], None]
    ) -> None:
        names = tokens(domain, robot, str(session.zid()))
        self._tokens = [session.liveliness().declare_token(name) for name in names]
        self._gid = hashlib.blake2b(names[-1].encode(), digest_size=GID_BYTES).digest()
        self._publisher = session.declare_publisher(key(domain))
        self._board = board
        self._report = report
        self._sequence = 0
        self._closing = threading.Event()
        self._thread = threading.Thread(
            target=retry_without_memory, args=(self._run, "ROS 2"), name="ros2", daemon=True
        )
        self._thread.start()

    def close(self) -> None:
        """Sends no more; before the session is closed."""
        self._closing.set()
        self._thread.join(CLOSE_S)

    def _run(self) -> None:
        while not self._closing.wait(PERIOD_S if self._sequence else 0.0):
            self._sequence += 1
            attached = attachment(self._sequence, time.time_ns(), self._gid)
            try:
                self._publisher.put(self._board.message(datetime.now(UTC)), attachment=attached)
            except zenoh.ZError as error:
                self._report(f"cannot publish for ROS 2: {error}")
            else:
                self._report("")
