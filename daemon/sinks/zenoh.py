"""Zenoh as a sink: scores, alarms and health as JSON under ``lostmotion/<robot>/``, and a liveliness token.

No transition of an alarm is lost to an advanced subscriber with recovery and history: the publisher keeps them in its
cache and sends their number by heartbeat.  Who joins late gets them as well, any other program the newest ones
by a ``get`` on the key.  The session is opened by a thread of its own, again and again while the router is away;
transitions wait for it, scores do not.  ``answers.py`` has the other keys that can be
queried, ``queries.py`` serves them.
"""

from __future__ import annotations

import logging
import threading
import time
from collections import deque
from pathlib import Path
from typing import TYPE_CHECKING

import zenoh
from msgspec.structs import asdict
from zenoh.ext import AdvancedPublisher, CacheConfig, MissDetectionConfig, declare_advanced_publisher

from lostmotion.daemon import documents
from lostmotion.daemon.no_memory import NO_MEMORY, is_no_memory, retry_without_memory
from lostmotion.daemon.options import ZenohOptions
from lostmotion.daemon.records import JointRow, ScoreRow, Transition, iso
from lostmotion.daemon.repeats import Condition
from lostmotion.daemon.sinks.answers import Answers, payload
from lostmotion.daemon.sinks.diagnostics import Board
from lostmotion.daemon.sinks.link_monitor import LOOK_S, LinkMonitor
from lostmotion.daemon.sinks.queries import Queries, Queryable
from lostmotion.daemon.zenoh_session import JSON, brief, clock_problem, configuration, why_closed

if TYPE_CHECKING:
    from lostmotion.daemon.sinks.ros2 import Ros2Publisher

__all__ = ["ZenohSink"]

log = logging.getLogger(__name__)

FIRST_RETRY_S = 1.0
LAST_RETRY_S = 30.0
CLOSE_S = 2.0
CACHED = 1000
"""transitions of a joint that an advanced subscriber may ask for, and that wait for a session: days of chatter"""
HEARTBEAT_S = 1.0
"""how soon a subscriber learns that it has missed a transition [s]"""


class ZenohSink:
    """Publishes for one robot.  Returns at once; the session opens in the background."""

    def __init__(self, robot: str, options: ZenohOptions, database: Path) -> None:
        self._robot = robot
        self._prefix = f"lostmotion/{robot}"
        self._options = options
        self._session: zenoh.Session | None = None
        self._token: zenoh.LivelinessToken | None = None  # gone from the network when it is gone from here
        self._lock = threading.RLock()  # held over a whole _keep, so that no older value follows a newer one
        self._latest: dict[tuple[str, str], bytes] = {}
        self._queries = Queries(robot, Answers(database, self._latest))
        self._board = Board(robot) if options.ros2 else None
        self._ros2: Ros2Publisher | None = None
        self._link_monitor: LinkMonitor | None = None
        self._waiting: deque[tuple[str, bytes]] = deque(maxlen=CACHED)
        self._published: deque[tuple[float, str, bytes]] = deque(maxlen=CACHED)  # when [s, monotonic], what
        self._publishers: dict[str, AdvancedPublisher] = {}
        self._score_publishers: dict[str, zenoh.Publisher] = {}
        self._condition = Condition(reported="")
        self._problem = ""
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._run, name="zenoh", daemon=True)
        self._thread.start()

    @property
    def is_open(self) -> bool:
        """Whether the session is open (which does not mean that anyone listens)."""
        return self._session is not None

    @property
    def problem(self) -> str:
        """What keeps it from publishing, "" for nothing."""
        if self._session is None:
            return self._problem or "no session yet"
        return self._problem or (self._link_monitor.problem if self._link_monitor else "")

    def score(self, row: ScoreRow) -> None:
        if self._board:
            self._board.score(row)
        values = asdict(row) | {"time": iso(row.time)}
        with self._lock:
            if self._session is None or self._is_beyond_time():
                return
            try:
                # In batches: of a burst that is sent one by one, Zenoh drops what finds both batches on their way.
                self._score_publisher(self._session, row.joint).put(payload(values))
            except zenoh.ZError as error:
                self._log_problem(f"cannot publish: {brief(error)}")
            else:
                self._log_problem("")

    def alarm(self, transition: Transition, again: bool = False) -> None:
        row = transition.alarm
        if self._board:
            self._board.alarm(row)
        self._keep(f"{row.joint}/alarm", row.cause.value, payload(documents.transition(transition)))

    def health(self, row: JointRow) -> None:
        if self._board:
            self._board.health(row)
        values = {"joint": row.name, "health": row.health.value, "since": iso(row.since), "reason": row.reason}
        self._keep(f"{row.name}/health", "", payload(values))

    def close(self) -> None:
        """Closes the session: an open one would keep the interpreter from ending."""
        self._closing.set()
        with self._lock:
            session, self._session = self._session, None
            self._forget_publishers()
        if self._link_monitor is not None:
            self._link_monitor.close()
        if self._ros2 is not None:
            self._ros2.close()
        if session is not None:
            session.close()  # type: ignore[no-untyped-call]
        self._thread.join(CLOSE_S)

    def _keep(self, key: str, kind: str, content: bytes) -> None:
        """Publishes what must not be lost, in order: it waits for a session, and for a publisher that takes it."""
        with self._lock:
            self._latest[key, kind] = content
            self._waiting.append((key, content))
            self._publish_waiting()

    def _is_beyond_time(self) -> bool:
        """Whether Zenoh cannot stamp anything now, which is logged as a problem."""
        if problem := clock_problem():
            self._log_problem(problem)
        return bool(problem)

    def _publish_waiting(self) -> None:
        while self._session is not None and self._waiting and not self._is_beyond_time():
            key, content = self._waiting[0]
            try:
                self._publisher(self._session, key).put(content)
            except zenoh.ZError as error:
                self._log_problem(f"cannot publish: {brief(error)}")
                return
            self._waiting.popleft()
            self._published.append((time.monotonic(), key, content))
            self._log_problem("")

    def _score_publisher(self, session: zenoh.Session, joint: str) -> zenoh.Publisher:
        """A session's ``put`` looks for the way to the subscribers each time, which takes twice as long."""
        if joint not in self._score_publishers:
            key = f"{self._prefix}/{joint}/score"
            self._score_publishers[joint] = session.declare_publisher(key, encoding=JSON)
        return self._score_publishers[joint]

    def _forget_publishers(self) -> None:
        self._publishers.clear()
        self._score_publishers.clear()

    def _publisher(self, session: zenoh.Session, key: str) -> AdvancedPublisher:
        if key not in self._publishers:
            self._publishers[key] = declare_advanced_publisher(
                session,
                f"{self._prefix}/{key}",
                encoding=JSON,
                congestion_control=zenoh.CongestionControl.BLOCK,  # a burst finds both batches on their way
                express=True,
                cache=CacheConfig(max_samples=CACHED),
                publisher_detection=True,
                # Without sequence numbers a subscriber to several keys drops what is older than another key's sample.
                sample_miss_detection=MissDetectionConfig(heartbeat=None, sporadic_heartbeat=HEARTBEAT_S),
            )
        return self._publishers[key]

    def _run(self) -> None:
        """The session's thread: opens it, again and again, then answers until it is closed or broken."""
        pause = FIRST_RETRY_S
        while not self._closing.is_set():
            session = None
            if self._is_beyond_time():
                self._closing.wait(FIRST_RETRY_S)
                continue
            try:
                config = configuration(self._options)
                session = zenoh.open(config)
                queryable = self._declare(session)
                self._use(session, config)
            except Exception as error:
                if not isinstance(error, zenoh.ZError) and not is_no_memory(error):
                    raise
                why = why_closed(self._options, error) if isinstance(error, zenoh.ZError) else NO_MEMORY
                self._log_problem(f"session not open, trying again: {why}")
                self._give_up(session)
                self._closing.wait(pause)
                pause = min(2 * pause, LAST_RETRY_S)
                continue
            pause = FIRST_RETRY_S
            retry_without_memory(lambda: self._queries.serve(queryable), "zenoh")  # noqa: B023 - it ends before the next

    def _declare(self, session: zenoh.Session) -> Queryable:
        """What others see of the robot in a session: that it is alive, and that it answers."""
        self._token = session.liveliness().declare_token(f"{self._prefix}/alive")
        queryable = session.declare_queryable(f"{self._prefix}/**")
        if self._board:
            from lostmotion.daemon.sinks.ros2 import Ros2Publisher  # TLS's hashes, 3 MB that many do not need

            domain = self._options.ros2_domain
            self._ros2 = Ros2Publisher(session, self._robot, domain, self._board, self._log_problem)
        return queryable

    def _give_up(self, session: zenoh.Session | None) -> None:
        """Closes a session that could not be used in full."""
        ros2, self._ros2, self._token = self._ros2, None, None
        if ros2 is not None:
            ros2.close()
        if session is not None:
            session.close()  # type: ignore[no-untyped-call]

    def _use(self, session: zenoh.Session, config: zenoh.Config) -> None:
        with self._lock:
            if self._closing.is_set():
                session.close()  # type: ignore[no-untyped-call]
                return
            self._link_monitor = LinkMonitor(session, config, self._leave)
            self._session, self._problem = session, ""
            self._publish_waiting()
        log.info("zenoh: session open as %s", session.zid())

    def _leave(self, linked_at: float) -> None:
        """Closes a session without a link, so that another one is opened, with what was published
        since a link was last seen [s, monotonic]: it may have reached nobody."""
        log.warning("zenoh: the session has lost its connection without noticing, as after lack of memory; "
                    "a new one is opened")  # fmt: skip
        with self._lock:
            self._give_up(self._session)  # where there is no memory for that either, it is tried again
            self._session = None
            self._forget_publishers()
            unconfirmed = [(key, content) for at, key, content in self._published if at >= linked_at - LOOK_S]
            self._waiting.extendleft(reversed(unconfirmed))
            self._published.clear()

    def _log_problem(self, problem: str) -> None:
        """Logs when publishing begins to fail and when it works again, not every time."""
        self._problem = problem
        if not self._condition.is_news("fails" if problem else "", time.monotonic()):
            return
        if problem:
            log.warning("zenoh: %s", problem)
        else:
            log.info("zenoh: publishing again")
