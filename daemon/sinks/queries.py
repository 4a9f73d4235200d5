"""Queries on Zenoh are answered here, by a few threads, until the session is closed; what the answers are stands in
``answers.py``.

An answer to a client that has stopped reading holds its thread until Zenoh gives the client up (5 s).  Histories, which
are long enough for that, have threads of their own: status and alarms are answered meanwhile.
"""

from __future__ import annotations

import threading
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress

import zenoh

from lostmotion.daemon.database import DAMAGED
from lostmotion.daemon.no_memory import NO_MEMORY
from lostmotion.daemon.sinks.answers import LONG, PARAMETERS, Answers, BadQueryError, payload
from lostmotion.daemon.zenoh_session import JSON
from lostmotion.drivers.errors import LostmotionError

__all__ = ["Queries", "Queryable"]

THREADS = 4
"""for histories, and as many for the rest"""
MOST_WAITING = 64
"""queries of one kind that are being answered or wait for it; more are dropped, and get no answer"""

Queryable = zenoh.Queryable[zenoh.handlers.Handler[zenoh.Query]]


class Queries:
    """Answers for one robot."""

    def __init__(self, robot: str, answers: Answers) -> None:
        self._robot, self._answers = robot, answers
        self._prefix = f"lostmotion/{robot}"

    def serve(self, queryable: Queryable) -> None:
        """Returns when the session is closed.

        In threads that can be waited for: Zenoh's own threads for Python callbacks survive the session, and one that
        returns while the interpreter ends aborts it.
        """
        short, long = _Pool("zenoh-short"), _Pool("zenoh-long")
        try:
            while True:
                query = queryable.recv()
                (long if _is_long(query) else short).submit(self, query)
        except zenoh.ZError:
            return
        finally:
            short.close()
            long.close()

    def answer(self, query: zenoh.Query) -> None:
        """Answers one query, with an error where it cannot be understood, the database cannot be read, or there is no
        memory for the answer."""
        with query, suppress(zenoh.ZError):
            try:
                self._reply(query)
            except (LostmotionError, *DAMAGED, MemoryError) as error:
                why = NO_MEMORY if isinstance(error, MemoryError) else str(error)
                query.reply_err(payload({"robot": self._robot, "error": why}), encoding=JSON)

    def _reply(self, query: zenoh.Query) -> None:
        parameters = {key: value for key in PARAMETERS if (value := query.parameters.get(key)) is not None}
        by_name = _is_long(query)
        keys = {name: f"{self._prefix}/{name}" for name in self._answers.names() if by_name is name.endswith(LONG)}
        found = [name for name, key in keys.items() if query.key_expr.intersects(zenoh.KeyExpr(key))]
        for name in found:
            for content in self._answers.to(name, parameters):
                query.reply(keys[name], content, encoding=JSON)
        if by_name and not found:
            raise BadQueryError(f"found no joint {str(query.key_expr).split('/')[-2]!r} here")


class _Pool:
    """A few threads, and a bounded number of queries that wait for them."""

    def __init__(self, name: str) -> None:
        self._threads = ThreadPoolExecutor(THREADS, name)
        self._places = threading.BoundedSemaphore(MOST_WAITING)

    def submit(self, queries: Queries, query: zenoh.Query) -> None:
        if self._places.acquire(blocking=False):
            try:
                self._threads.submit(queries.answer, query).add_done_callback(lambda _: self._places.release())
            except (MemoryError, RuntimeError):  # no memory for it, or for a thread; the next one may be answered
                self._places.release()
                query.drop()  # type: ignore[no-untyped-call]
        else:
            query.drop()  # type: ignore[no-untyped-call]

    def close(self) -> None:
        """Waits for the queries that are being answered; those that wait are dropped."""
        self._threads.shutdown(cancel_futures=True)


def _is_long(query: zenoh.Query) -> bool:
    """Whether a long answer is asked for by its name, not with all else of a joint."""
    return str(query.key_expr).endswith(LONG)
