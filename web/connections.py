"""The connections of the page's server: those whose request has not come keep no other out."""

from __future__ import annotations

import asyncio
import itertools
import logging
from typing import Any

import h11
from uvicorn.protocols.http.h11_impl import H11Protocol

__all__ = ["MOST_OPEN", "MOST_WAITING", "Connection", "is_worth_a_line"]

MOST_OPEN = 128
"""open at the same time, those that wait included; one more is answered with status 503"""
MOST_WAITING = 32
"""whose request is not complete, or that are kept for the next one: a browser keeps six, for 5 s"""
_arrivals = itertools.count()


def is_worth_a_line(record: logging.LogRecord) -> bool:
    """A filter of uvicorn's log: a request that the end of the server cuts off is no error."""
    return not (record.exc_info and isinstance(record.exc_info[1], asyncio.CancelledError))


class Connection(H11Protocol):
    """A connection of HTTP/1.1.  Where one too many waits for its request, the one that has waited longest is closed:
    a browser sends its request at once, and nobody needs the password to open connections that say nothing."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self._arrived = 0

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Takes its place at the end of the queue, and closes the head of a queue that is too long."""
        super().connection_made(transport)
        self._arrived = next(_arrivals)
        waiting = [other for other in self.connections if isinstance(other, Connection) and other.is_waiting]
        if len(waiting) > MOST_WAITING:
            min(waiting, key=lambda other: other._arrived).transport.close()

    def data_received(self, data: bytes) -> None:
        """A request that is complete gives up the place; what the connection sends next has a new one."""
        super().data_received(data)
        if not self.is_waiting:
            self._arrived = next(_arrivals)

    def shutdown(self) -> None:
        """As the server ends: what would not end by itself, a stream of events or half a request, is cut off."""
        super().shutdown()
        if self.is_waiting or (self.scope and self.scope["path"].endswith("/events")):
            self.transport.close()

    @property
    def is_waiting(self) -> bool:
        """Whether a request, or the rest of one, is still to come."""
        return self.conn.their_state in (h11.IDLE, h11.SEND_BODY) and not self.transport.is_closing()
