"""Zenoh as a sink: scores, alarms and health as JSON under ``lostmotion/<robot>/``, and a liveliness token.

The session is opened by a thread of its own, again and again while the router is away; what happens meanwhile is not
sent later, except the newest health of every joint and its newest alarms.  Who joins late gets these as well: an
advanced subscriber from the publisher's cache, any other program by a ``get`` on the key.
"""

from __future__ import annotations

import json
import logging
import re
import threading
from collections.abc import Callable, Mapping
from contextlib import suppress
from datetime import datetime

import msgspec
import zenoh
from zenoh.ext import AdvancedPublisher, CacheConfig, MissDetectionConfig, declare_advanced_publisher

from lostmotion.daemon import documents
from lostmotion.daemon.options import ZenohOptions
from lostmotion.daemon.records import JointRow, ScoreRow, Transition, iso

__all__ = ["SCHEMA", "ZenohSink"]

log = logging.getLogger(__name__)

SCHEMA = 1
"""version of the payloads: grows when a key changes its meaning or goes away"""
FIRST_RETRY_S = 1.0
LAST_RETRY_S = 30.0
CLOSE_S = 2.0
CACHED = 8
"""transitions of a joint that an advanced subscriber may ask for"""
HEARTBEAT_S = 1.0
"""how soon a subscriber learns that it has missed a transition [s]"""


class ZenohSink:
    """Publishes for one robot.  Returns at once; the session opens in the background."""

    def __init__(self, robot: str, options: ZenohOptions) -> None:
        self._prefix = f"lostmotion/{robot}"
        self._options = options
        self._session: zenoh.Session | None = None
        self._token: zenoh.LivelinessToken | None = None  # gone from the network when it is gone from here
        self._lock = threading.RLock()  # held over a whole _keep, so that no older value follows a newer one
        self._latest: dict[tuple[str, str], bytes] = {}
        self._publishers: dict[str, AdvancedPublisher] = {}
        self._failing = False
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._open, name="zenoh", daemon=True)
        self._thread.start()

    @property
    def is_open(self) -> bool:
        """Whether the session is open (which does not mean that anyone listens)."""
        return self._session is not None

    def score(self, row: ScoreRow) -> None:
        values = {name: getattr(row, name) for name in ScoreRow.__dataclass_fields__}
        self._put(f"{row.joint}/score", _payload(values))

    def alarm(self, transition: Transition, again: bool = False) -> None:
        row = transition.alarm
        self._keep(f"{row.joint}/alarm", row.cause.value, _payload(documents.transition(transition)))

    def health(self, row: JointRow) -> None:
        values = {"joint": row.name, "health": row.health.value, "since": row.since, "reason": row.reason}
        self._keep(f"{row.name}/health", "", _payload(values))

    def close(self) -> None:
        """Closes the session: an open one would keep the interpreter from ending."""
        self._closing.set()
        with self._lock:
            session, self._session = self._session, None
            self._publishers.clear()
        if session is not None:
            session.close()  # type: ignore[no-untyped-call]
        self._thread.join(CLOSE_S)

    def _keep(self, key: str, kind: str, payload: bytes) -> None:
        """Publishes what late joiners will ask for."""
        with self._lock:
            self._latest[key, kind] = payload
            self._publish(lambda session: self._publisher(session, key).put(payload))

    def _put(self, key: str, payload: bytes) -> None:
        # Express: a window's score is alone and has no batch to wait for.
        self._publish(
            lambda session: session.put(
                f"{self._prefix}/{key}", payload, encoding=zenoh.Encoding.APPLICATION_JSON, express=True
            )
        )

    def _publish(self, how: Callable[[zenoh.Session], None]) -> None:
        with self._lock:
            if self._session is None:
                return
            try:
                how(self._session)
            except zenoh.ZError as error:
                self._say(f"cannot publish: {_brief(error)}")
                return
        self._say("")

    def _publisher(self, session: zenoh.Session, key: str) -> AdvancedPublisher:
        if key not in self._publishers:
            self._publishers[key] = declare_advanced_publisher(
                session,
                f"{self._prefix}/{key}",
                encoding=zenoh.Encoding.APPLICATION_JSON,
                express=True,
                cache=CacheConfig(max_samples=CACHED),
                publisher_detection=True,
                # Without sequence numbers a subscriber to several keys drops what is older than another key's sample.
                sample_miss_detection=MissDetectionConfig(heartbeat=None, sporadic_heartbeat=HEARTBEAT_S),
            )
        return self._publishers[key]

    def _answer(self, queryable: zenoh.Queryable[zenoh.handlers.Handler[zenoh.Query]]) -> None:
        """Tells the newest alarms and health of the joints that queries name, until the session is closed.

        In a thread that ``close`` can wait for: Zenoh's own threads for Python callbacks outlive the session, and one
        that returns while the interpreter ends aborts it.
        """
        while True:
            try:
                query = queryable.recv()
            except zenoh.ZError:
                return
            with query, suppress(zenoh.ZError):
                for (name, _), payload in list(self._latest.items()):
                    key = f"{self._prefix}/{name}"
                    if query.key_expr.intersects(zenoh.KeyExpr(key)):
                        query.reply(key, payload, encoding=zenoh.Encoding.APPLICATION_JSON)

    def _open(self) -> None:
        pause = FIRST_RETRY_S
        while not self._closing.is_set():
            try:
                session = zenoh.open(_config(self._options))
                self._token = session.liveliness().declare_token(f"{self._prefix}/alive")
                queryable = session.declare_queryable(f"{self._prefix}/*/*")
            except zenoh.ZError as error:
                self._say(f"session not open, trying again: {_brief(error)}")
                self._closing.wait(pause)
                pause = min(2 * pause, LAST_RETRY_S)
                continue
            self._use(session)
            self._answer(queryable)
            return

    def _use(self, session: zenoh.Session) -> None:
        with self._lock:
            if self._closing.is_set():
                session.close()  # type: ignore[no-untyped-call]
                return
            self._session = session
            for (key, kind), payload in list(self._latest.items()):
                self._keep(key, kind, payload)
        log.info("zenoh: session open as %s %s", self._options.mode, session.zid())
        if self._options.connect and not (session.info.routers_zid() or session.info.peers_zid()):
            log.warning("zenoh: nobody answers at %s yet; it is tried on", ", ".join(self._options.connect))

    def _say(self, problem: str) -> None:
        """Logs when publishing begins to fail and when it works again, not every time."""
        if problem and not self._failing:
            log.warning("zenoh: %s", problem)
        elif self._failing and not problem:
            log.info("zenoh: publishing again")
        self._failing = bool(problem)


def _payload(values: Mapping[str, object]) -> bytes:
    """JSON with the schema's number, UTC as text, and null for what is unknown."""
    plain = {key: iso(value) if isinstance(value, datetime) else value for key, value in values.items()}
    return msgspec.json.encode({"schema": SCHEMA} | plain)


def _brief(error: zenoh.ZError) -> str:
    """The error without the places in Zenoh's source that it names."""
    return re.sub(r"\s*at \S+\.rs:\d+\.?", "", str(error))


def _config(options: ZenohOptions) -> zenoh.Config:
    config = zenoh.Config()
    settings = {
        "mode": options.mode,
        "connect/endpoints": options.connect,
        "listen/endpoints": options.listen,
        "scouting/multicast/enabled": options.multicast_scouting,
        "timestamping/enabled": True,  # the publishers' cache orders by it
    }
    for key, value in settings.items():
        config.insert_json5(key, json.dumps(value))
    return config
